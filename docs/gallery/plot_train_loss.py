"""
HOG as a loss beside another one
================================

A tiny thumbnail has the colours of a photograph, a HOG has its edges. Which image has both? Two losses, one sum, and
any optimiser of PyTorch.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data
from torch.nn.functional import adaptive_avg_pool2d, interpolate, mse_loss

import nablahog

SIDE, STEPS = 128, 600
photograph = Image.fromarray(data.astronaut()).crop((90, 0, 346, 256)).resize((SIDE, SIDE), Image.Resampling.LANCZOS)
target = torch.from_numpy(np.array(photograph)).permute(2, 0, 1)[None] / 255  # (1, 3, H, W)

# %%
# What is known
# -------------
# ``HOGLoss`` takes images, and compares nothing but their descriptors.

thumbnail = adaptive_avg_pool2d(target, 8)
hog_loss = nablahog.HOGLoss(nablahog.presets.uoctti(cell_size=4))  # a module, as any other loss
print(f"a thumbnail {tuple(thumbnail.shape)}, and {hog_loss}")

# %%
# Two losses, one sum
# -------------------
# The third term prefers smooth images. At each pixel, HOG takes the channel of largest gradient; without
# this term, noise in the other channels costs nothing.

enlarged = interpolate(thumbnail, size=(SIDE, SIDE), mode="bicubic").clamp(0, 1)
torch.manual_seed(0)
image = (enlarged + 0.005 * torch.randn_like(enlarged)).requires_grad_()
optimizer = torch.optim.Adam([image], lr=0.03)
schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
curves: dict[str, list[float]] = {"colours": [], "edges": [], "photograph (not used)": []}
for _ in range(STEPS):
    of_colours = mse_loss(adaptive_avg_pool2d(image, 8), thumbnail)
    of_edges = hog_loss(image, target)
    smooth = (image.diff(dim=2) ** 2).mean() + (image.diff(dim=3) ** 2).mean()
    loss = 10 * of_colours + 0.03 * of_edges + 0.3 * smooth
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    schedule.step()
    with torch.no_grad():
        for curve, value in zip(curves.values(), (of_colours, of_edges, mse_loss(image, target)), strict=True):
            curve.append(float(value))

# %%

figure, panels = plt.subplots(1, 4, figsize=(11, 3.2), width_ratios=[1, 1, 1, 1.3], layout="constrained")
for axes, picture, title in zip(
    panels,
    (interpolate(thumbnail, size=(SIDE, SIDE)), image.detach().clamp(0, 1), target),
    ("thumbnail, 8x8 pixels", "image with both losses", f"photograph, {SIDE}x{SIDE}"),
    strict=False,
):
    axes.imshow(picture[0].permute(1, 2, 0))
    axes.set_title(title)
    axes.set_axis_off()
for name, curve in curves.items():
    panels[3].plot(curve, label=name)
panels[3].set(yscale="log", xlabel="steps of Adam", ylabel="loss")
panels[3].legend(fontsize=8)
plt.show()

# %%
# Two curves are mean squares of differences, of thumbnails and of pixels in 0…1; that of edges is ‖φ(x) − φ(y)‖² /
# ‖φ(y)‖². No loss compares the pixels; their curve falls because an image with these colours and these edges is much
# like the photograph.
