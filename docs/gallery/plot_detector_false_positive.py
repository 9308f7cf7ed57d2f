"""
What a detector saw
===================

OpenCV's detector of people finds one where there is none. From the HOG of that window alone an image is found that has
the same HOG: it shows what was left of the photograph for the detector, after Vondrick et al., *HOGgles* (ICCV 2013).
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle
from PIL import Image
from skimage import data

import nablahog
from nablahog.compat.opencv import HOGDescriptor

detector = HOGDescriptor()
detector.setSVMDetector(HOGDescriptor.getDefaultPeopleDetector())
photograph = np.ascontiguousarray(data.rocket())  # nobody is in it
boxes, scores = detector.detectMultiScale(photograph, winStride=(8, 8), scale=1.05, groupThreshold=0)
x, y, width, height = boxes[np.argmax(scores)]
print(f"{len(boxes)} people; the surest, score {np.max(scores):.2f}, at x {x}, y {y}, {width}x{height} pixels")

# %%
# The window, as large as the detector's
# --------------------------------------

y, x = max(y, 0), max(x, 0)
window = Image.fromarray(photograph[y : y + height, x : x + width]).resize((64, 128))
spec = nablahog.presets.opencv()  # windows of 64x128 pixels (width x height)
descriptor = nablahog.hog(np.asarray(window), spec)
again = nablahog.reconstruct(descriptor, spec, (128, 64))
print(f"the pre-image's HOG is {again.distance:.1%} off")

# %%
# The detector scores the HOG alone, so it takes the pre-image for a person, too. This HOG does not tell bright
# from dark: the prior takes the rocket for something dark in front of a bright sky.

gray = np.rint(255 * again.image).astype(np.uint8)
weights = HOGDescriptor.getDefaultPeopleDetector().ravel()
for name, pixels in ("window", np.asarray(window)), ("pre-image", gray):
    print(f"{name:10} {float(detector.compute(pixels) @ weights[:-1] + weights[-1]):6.2f}")

figure, axes = plt.subplots(1, 4, figsize=(9, 4.2), width_ratios=[2.2, 1, 1, 1], layout="constrained")
axes[0].imshow(photograph)
axes[0].add_patch(Rectangle((x, y), width, height, fill=False, color="tab:red", linewidth=2))
axes[1].imshow(window)
axes[2].imshow(nablahog.glyphs(descriptor, spec), cmap="gray")
axes[3].imshow(gray, cmap="gray", vmin=0, vmax=255)
for each, title in zip(axes, ("a person?", "window", "its HOG", "pre-image"), strict=True):
    each.set(title=title)
    each.axis("off")
plt.show()
