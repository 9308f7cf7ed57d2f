"""
Which pixels does a detector's score depend on?
===============================================

OpenCV's detector runs a linear SVM over HOG windows. ``nablahog.compat.opencv`` computes the same scores as a
differentiable function of the image, so the derivative says which pixels to make brighter or darker for a higher score.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.patches import Rectangle
from PIL import Image
from skimage import data

import nablahog

# %%
# A detector from one window
# --------------------------
# The detector is made here, so that no file is needed: the descriptor of one window of a small photograph, less the
# mean of all windows. ``HOGDescriptor`` has the names and results of OpenCV's class. With OpenCV, set its people
# detector instead:
# ``descriptor.setSVMDetector(descriptor.getDefaultPeopleDetector())``.

photograph = data.astronaut()
small = np.asarray(Image.fromarray(photograph).resize((256, 256)))
descriptor = nablahog.compat.opencv.HOGDescriptor()
window = descriptor.compute(small, locations=[(76, 8)])
mean = descriptor.compute(small).reshape(-1, len(window)).mean(axis=0)
weights = window - mean
descriptor.setSVMDetector(np.append(weights, -weights @ (window + mean) / 2))

# %%
# Detect
# ------
# In the photograph of 512x512 pixels the person is twice as large; the pyramid of scales finds her.

rectangles, scores = descriptor.detectMultiScale(photograph, scale=1.05, groupThreshold=0)
x, y, width, height = (int(value) for value in rectangles[np.argmax(scores)])
print(
    f"{len(rectangles)} windows found, the best at {x}, {y}, {width}x{height} pixels, with a score of {max(scores):.2f}"
)

# %%
# The derivative of the score
# ---------------------------
# ``nablahog.compat.opencv.score`` takes windows as tensors (B, C, H, W) in 0…1. A few steps of gradient ascent show
# what the derivative means: the window becomes what the detector looks for.

crop = Image.fromarray(photograph).crop((x, y, x + width, y + height)).resize((64, 128))
before = torch.from_numpy(np.array(crop)).permute(2, 0, 1)[None] / 255
image = before.clone()
values, derivatives = [], []
for _ in range(31):
    image.requires_grad_()
    value = nablahog.compat.opencv.score(image, descriptor).sum()
    (gradient,) = torch.autograd.grad(value, image)
    values.append(float(value.detach()))
    derivatives.append(gradient)
    image = (image.detach() + 0.01 * gradient / gradient.abs().amax()).clamp(0, 1)
print(f"score {values[0]:.2f}, after 30 steps along its derivative {values[-1]:.2f}")

# %%
# Is it the derivative?
# ---------------------
# A photograph of 8 bits lies on many ties: two channels with the same gradient, of which one counts. There the score
# jumps, and no difference quotient is the derivative. A little noise breaks the ties. OpenCV's arctangent is a
# polynomial that errs by up to 3e-4 rad; with ``angle="exact"`` the derivative is exactly that of the score.

torch.manual_seed(0)
noisy = (0.05 + 0.9 * before.double() + 1e-3 * torch.rand_like(before, dtype=torch.float64)).requires_grad_()
(exact,) = torch.autograd.grad(nablahog.compat.opencv.score(noisy, descriptor, "exact").sum(), noisy)
direction, h = exact / exact.norm(), 1e-6
with torch.no_grad():
    ahead, behind = (
        nablahog.compat.opencv.score(noisy + step * direction, descriptor, "exact").sum() for step in (h, -h)
    )
print(f"derivative along itself {float(exact.norm()):.6f}, central difference {float(ahead - behind) / (2 * h):.6f}")

# %%
# Pictures
# --------

figure, panels = plt.subplots(1, 5, figsize=(11, 4), width_ratios=[2, 1, 1.25, 1, 1], layout="constrained")
panels[0].imshow(photograph)
panels[0].add_patch(Rectangle((x, y), width, height, fill=False, edgecolor="cyan", linewidth=2))
panels[0].set_title("photograph and best window")
panels[1].imshow(before[0].permute(1, 2, 0))
panels[1].set_title(f"window,\nscore {values[0]:.2f}")
total = derivatives[0][0].sum(dim=0)  # over R, G, B: of making a pixel brighter
limit = float(total.abs().quantile(0.99))
shown = panels[2].imshow(total, cmap="RdBu", vmin=-limit, vmax=limit)
panels[2].set_title("derivative of\nthe score")
figure.colorbar(shown, ax=panels[2], shrink=0.6, extend="both", label="score / gray value")
panels[3].imshow(image.detach()[0].permute(1, 2, 0))
panels[3].set_title(f"30 steps later,\nscore {values[-1]:.2f}")
spec = nablahog.presets.opencv()
positive = np.maximum(nablahog.from_layout(weights, spec, (128, 64)), 0)
panels[4].imshow(nablahog.glyphs(positive, spec), cmap="gray")
panels[4].set_title("positive\nweights")
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# Left to right: where the detector sees the person; the window at the detector's size, 64x128 pixels; the
# derivative, blue where brighter pixels raise the score, with the largest 1 % cut off; the window after the steps,
# which looks nearly the same; the weights that speak for a person. The derivative is largest where the window is black:
# OpenCV takes the root of all values first, and that is steepest near 0.
