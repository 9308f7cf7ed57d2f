"""
Similarity and its gradient over 360° of azimuth
================================================

A pose search follows the derivative of a similarity. How does the similarity look all around the object, and does its
derivative point to the maximum? This is the paper's figure, for a chair.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data
from torch import Tensor
from torch.nn.functional import cosine_similarity

import nablahog

# %%
# A photograph of known pose
# --------------------------
# A chair at an azimuth of 60° is rendered in front of a part of a photograph.

TRUE = 60.0
mesh = nablahog.sample_chairs()["wooden-0"]
camera = nablahog.Camera.from_field_of_view(30, height=96, width=96)
clutter = np.array(Image.fromarray(data.chelsea()).convert("L").crop((280, 130, 430, 280)).resize((96, 96)))
background = torch.from_numpy(clutter)[None, None] / 255
renderer = nablahog.Renderer(mesh, camera)


def poses(azimuths: Tensor) -> Tensor:
    """Poses (B, 6) at azimuths (B,) in degrees, with the true elevation and distance."""
    rest = torch.tensor([20.0, 2.2, 0.0, 0.0, 0.0], dtype=torch.float64)
    return torch.cat([azimuths[:, None], rest.expand(len(azimuths), 5)], dim=1)


photograph = renderer(poses(torch.tensor([TRUE], dtype=torch.float64)), background)

# %%
# The similarity
# --------------
# The cosine of the descriptors of the photograph and of a rendering on white. Both steps are differentiable, so
# ``backward`` gives the derivative by the azimuth, per degree.

spec = nablahog.presets.uoctti(cell_size=8)
template = nablahog.hog(photograph, spec).flatten(1)


def similarity(azimuths: Tensor) -> Tensor:
    """(B,) at azimuths (B,)."""
    return cosine_similarity(nablahog.hog(renderer(poses(azimuths)), spec).flatten(1), template)


around = torch.arange(0.0, 360.0, 1.0, dtype=torch.float64).requires_grad_()
values = similarity(around)
(derivatives,) = torch.autograd.grad(values.sum(), around)
values = values.detach()
with torch.no_grad():
    ahead, behind = similarity(around + 1.5), similarity(around - 1.5)
differences = (ahead - behind).double() / 3
agreement = cosine_similarity(derivatives, differences, dim=0)
print(f"largest similarity {float(values.max()):.3f} at {int(values.argmax())}°, the true azimuth is {TRUE:g}°")
print(f"derivatives and central differences over 3°: cosine {float(agreement):.3f},", end=" ")
print(f"equal signs at {float((derivatives.sign() == differences.sign()).double().mean()):.0%} of the azimuths")

# %%

figure = plt.figure(figsize=(10, 6), layout="constrained")
grid = figure.add_gridspec(3, 9, height_ratios=[3, 2, 1.3])
top, low = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, :])
degrees = around.detach()
top.plot(degrees, values)
top.axvline(TRUE, color="tab:red", label=f"true azimuth, {TRUE:g}°")
top.set(ylabel="similarity (cosine)", xlim=(0, 360), xticks=range(0, 361, 45))
top.legend(loc="upper right")
low.plot(degrees, differences, color="0.7", linewidth=3, label="central difference over 3°")
low.plot(degrees, derivatives, color="tab:blue", linewidth=1, label="derivative")
low.axhline(0, color="black", linewidth=0.5)
low.axvline(TRUE, color="tab:red")
low.set(ylabel="per degree", xlabel="azimuth in degrees", xlim=(0, 360), xticks=range(0, 361, 45))
low.legend(loc="upper right", ncols=2)
views = [photograph, *renderer(poses(torch.arange(0.0, 360.0, 45.0, dtype=torch.float64)))[:, None]]
for k, view in enumerate(views):
    axes = figure.add_subplot(grid[2, k])
    axes.imshow(view[0, 0], cmap="gray", vmin=0, vmax=1)
    axes.set_title("photograph" if k == 0 else f"{45 * (k - 1)}°", fontsize=9)
    axes.set_axis_off()
plt.show()

# %%
# Both curves are jagged below a degree: each sample that an edge passes moves the descriptor. The derivative is that of
# the jagged curve; over a few degrees its mean is the visible slope.
#
# Where would ascent end?
# -----------------------
# From each azimuth, ascent ends at a local maximum, here of the similarity's means over 15°.

kernel = torch.ones(1, 1, 15, dtype=torch.float64) / 15
wrapped = torch.nn.functional.pad(values.double()[None, None], (7, 7), mode="circular")
smooth = torch.nn.functional.conv1d(wrapped, kernel)[0, 0]
ends = torch.arange(360)
for _ in range(360):
    uphill = torch.stack([smooth[(ends + step) % 360] for step in (-1, 0, 1)]).argmax(0) - 1
    ends = (ends + uphill) % 360
for end in sorted(set(ends.tolist())):
    print(
        f"from {int((ends == end).sum()):3} of 360 azimuths the way uphill ends at {end}°, similarity {smooth[end]:.3f}"
    )

# %%
# There are several maxima, so a search must begin at many azimuths, as ``nablahog.estimate_pose`` does:
# :ref:`sphx_glr_auto_gallery_plot_pose_chair.py`.
