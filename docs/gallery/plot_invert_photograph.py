"""
What does a HOG keep of a photograph?
=====================================

``nablahog.reconstruct`` takes a descriptor, and nothing else, and returns an image with this descriptor: a pre-image.
What it shares with the photograph is what the descriptor has kept.
"""

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from skimage import data

import nablahog

photograph = Image.fromarray(data.chelsea()).crop((60, 10, 340, 290)).resize((128, 128))
gray = np.asarray(photograph.convert("L")) / 255

# %%
# One descriptor, one pre-image
# -----------------------------
# The spec names the dialect: the 31 channels of Felzenszwalb et al. with cells of 8 pixels.

spec = nablahog.presets.uoctti(cell_size=8)
descriptor = nablahog.hog(photograph, spec)  # (rows, cols, 31): all that is known from here on
result = nablahog.reconstruct(descriptor, spec, (128, 128), seed=0)
print(result)

figure, panels = plt.subplots(1, 4, figsize=(11, 3.5), layout="constrained")
panels[0].imshow(photograph)
panels[0].set_title("photograph, 128x128 pixels")
panels[1].imshow(nablahog.glyphs(descriptor, spec), cmap="gray")
panels[1].set_title(f"glyphs of {descriptor.size} numbers")
panels[2].imshow(result.image, cmap="gray", vmin=0, vmax=1)
panels[2].set_title("pre-image")
shown = panels[3].imshow(result.image - gray, cmap="RdBu", vmin=-0.5, vmax=0.5)
panels[3].set_title("pre-image − photograph")
figure.colorbar(shown, ax=panels[3], shrink=0.7, label="gray value, 0…1")
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# How good is it?
# ---------------
# ``distance`` compares descriptors: how well the image explains the given one. It can always be computed. The other
# measures compare images, and need the photograph.

for name, value in {
    "distance": result.distance.item(),
    "CC": nablahog.metrics.cross_correlation(gray, result.image),
    "MI": nablahog.metrics.mutual_information(gray, result.image),
    "SSIM": nablahog.metrics.ssim(gray, result.image),
}.items():
    print(f"{name:8} {value:.3f}   {nablahog.metrics.DEFINITIONS[name]}")

# %%
# Smaller cells keep more
# -----------------------
# The descriptor of cells of 4 pixels has more numbers than the photograph has pixels; of cells of 16 pixels, fewer by a
# factor of eight.

figure, panels = plt.subplots(1, 4, figsize=(11, 3.5), layout="constrained")
panels[0].imshow(gray, cmap="gray", vmin=0, vmax=1)
panels[0].set_title(f"photograph, {gray.size} pixels")
for axes, cell in zip(panels[1:], (4, 8, 16), strict=True):
    spec = nablahog.presets.uoctti(cell_size=cell)
    descriptor = nablahog.hog(photograph, spec)
    result = nablahog.reconstruct(descriptor, spec, (128, 128), quality="fast", seed=0)
    axes.imshow(result.image, cmap="gray", vmin=0, vmax=1)
    correlation = nablahog.metrics.cross_correlation(gray, result.image)
    axes.set_title(f"cells of {cell} pixels: CC {correlation:.2f}\n{descriptor.size} numbers", fontsize=10)
for axes in panels:
    axes.set_axis_off()
plt.show()
