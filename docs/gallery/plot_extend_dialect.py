"""
Your own HOG
============

A paper describes its own HOG: more bins, with signs; cells that overlap; a normaliser that divides by the energy of the
neighbourhood. Such a dialect needs no code: a ``HOGSpec`` names its conventions, and everything works with it, also
derivatives and inversion.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data

import nablahog
from nablahog.hog import BilinearCells, CellNorm

# %%
# All conventions, by name
# ------------------------
# You must set the fields without a default; ``help(nablahog.HOGSpec)`` explains each.

spec = nablahog.HOGSpec(
    name="mine",
    value_range=1.0,  # ε of the normaliser is for images in 0…1
    colour="largest",  # at each pixel the channel of largest gradient
    border="replicate",  # one-sided differences at the border
    bins=12,
    signed=True,  # over 360°, each 30° wide
    bin_offset=0.0,  # the first is centred at 0°
    vote="linear",  # shared by the two nearest bins
    cell_size=(8, 8),
    partial_cells="floor",
    normalizer=CellNorm(epsilon=0.1),  # each cell for itself
    pooling=BilinearCells(),  # a pixel votes into four cells
    mask="sobel",
)
print(spec)
print(f"an image of 128x96 pixels has {spec.grid(128, 96)} cells of {spec.channels} channels")

# %%
# Fields that contradict each other are an error in one sentence:

try:
    replace(spec, layout="blocks")
except ValueError as error:
    print(error)

# %%
# A spec travels as one line of JSON, so that a descriptor and its spec can be stored together:

assert nablahog.HOGSpec.from_json(spec.to_json()) == spec
print(spec.to_json()[:100], "…")

# %%
# Its derivative
# --------------
# For a random direction u: the derivative of the sum of squares along u, and its central difference.

torch.manual_seed(0)
image = torch.rand(1, 3, 48, 48, dtype=torch.float64)
direction, h = torch.randn_like(image), 1e-6
along = torch.func.jvp(lambda x: nablahog.hog(x, spec).square().sum(), (image,), (direction,))[1]
ahead, behind = (nablahog.hog(image + step * direction, spec).square().sum() for step in (h, -h))
print(f"derivative {float(along):.6f}, central difference {float(ahead - behind) / (2 * h):.6f}")

# %%
# Its pre-image
# -------------

photograph = Image.fromarray(data.coffee()).crop((150, 20, 500, 370)).resize((128, 128))
descriptor = nablahog.hog(photograph, spec)
result = nablahog.reconstruct(descriptor, spec, (128, 128), quality="fast", seed=0)
gray = np.asarray(photograph.convert("L"))
correlation = nablahog.metrics.cross_correlation(gray, result.image)

figure, panels = plt.subplots(1, 3, figsize=(9, 3.4), layout="constrained")
for axes, picture, title in zip(
    panels,
    (photograph, nablahog.glyphs(descriptor, spec), result.image),
    ("photograph, 128x128 pixels", "glyphs", f"pre-image: CC {correlation:.2f}, distance {result.distance:.2f}"),
    strict=True,
):
    axes.imshow(picture, cmap="gray")
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()
plt.show()

# %%
# How far it is from the HOG of a library: :doc:`plot_compare_hogs`.
