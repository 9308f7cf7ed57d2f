"""
Which HOG is my vector?
=======================

A file holds 3780 numbers and the note "HOG of 128x64 pixels". OpenCV and scikit-image both return vectors of that
length, and so does the descriptor of Dalal and Triggs's paper. Which one is it?

``nablahog.which_hog`` answers from the numbers alone. With the photograph, computing the candidates shows that all
conventions are right; without it, an inversion shows that the order of the numbers is.
"""

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from skimage import data
from skimage.color import rgb2gray
from skimage.feature import hog as skimage_hog

import nablahog

photograph = np.array(Image.fromarray(data.astronaut()).crop((90, 0, 346, 512)).resize((64, 128)))
gray = np.array(Image.fromarray(photograph).convert("L"))

# the unknown vector; the checks below do not use what this line says
vector = skimage_hog(gray, cells_per_block=(2, 2)).astype(np.float32)

# %%
# 1. Ask
# ------
# The presets that make 3780 numbers of an image of this size are counted, and what their normalisers make hold exactly
# is checked until one is left. The answer says which check decided.

found = nablahog.which_hog(vector, (128, 64))
print(found)
for candidate in found.candidates[:4]:
    print(candidate.summary)

# %%
# 2. Look at the values
# ---------------------
# These are the values that decided. scikit-image scales each block to length 1 exactly. OpenCV adds 0.001 before it
# divides, so its blocks are a little shorter. With L2-Hys, the largest entries of a block were clipped, and are equal.

blocks = vector.reshape(-1, 36)
lengths = np.linalg.norm(blocks, axis=1)
clipped = np.isclose(blocks, blocks.max(axis=1, keepdims=True), rtol=1e-6).sum(axis=1) > 1
print(f"lengths of the blocks: {lengths.min():.6f} … {lengths.max():.6f}")
print(f"blocks with two or more equal largest entries: {clipped.mean():.0%}")

# %%
# Length 1 and equal largest entries: this is scikit-image with L2-Hys.
#
# 3. Compute the candidates
# -------------------------
# ``layout="native"`` returns the order of numbers of the library itself. The right candidate agrees to rounding. How a
# colour image became gray is part of the question: Pillow and scikit-image weigh R, G, B differently.

candidates = {
    "opencv": nablahog.presets.opencv(),
    "opencv, gamma=False": nablahog.presets.opencv(gamma=False),
    "skimage 2x2": found.candidates[0].spec,
    "skimage 2x2, largest channel": nablahog.presets.skimage(cells_per_block=(2, 2), channel_axis=-1),
    "skimage 2x2, L2": nablahog.presets.skimage(cells_per_block=(2, 2), block_norm="L2"),
    "dalal_triggs": nablahog.presets.dalal_triggs(),
}
weighted = np.uint8(np.round(255 * rgb2gray(photograph)))
attempts = [
    ("opencv", "R, G, B", photograph),
    ("opencv, gamma=False", "R, G, B", photograph),
    ("dalal_triggs", "R, G, B", photograph),
    ("skimage 2x2, largest channel", "R, G, B", photograph),
    ("skimage 2x2, L2", "gray by Pillow", gray),
    ("skimage 2x2", "gray by scikit-image", weighted),
    ("skimage 2x2", "gray by Pillow", gray),
]
distances = {}
for name, image_name, image in attempts:
    candidate = nablahog.hog(image, candidates[name], layout="native").ravel()
    distances[f"{name}; {image_name}"] = float(np.linalg.norm(candidate - vector) / np.linalg.norm(vector))

figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
bars = axes.barh(list(distances), list(distances.values()), color="tab:blue")
axes.bar_label(bars, [f"{distance:.1e}" for distance in distances.values()], padding=4)
axes.set(xscale="log", xlim=(1e-9, 100), xlabel="relative distance ‖candidate − vector‖ / ‖vector‖, no unit")
axes.invert_yaxis()
plt.show()

# %%
# The vector is scikit-image's, of the gray image that Pillow makes.
#
# 4. Without the photograph: invert
# ---------------------------------
# Under the right hypothesis the pre-image looks like a photograph. Under a wrong one the cells are in a wrong order.

figure, panels = plt.subplots(1, 4, figsize=(8, 4.9), layout="constrained")
panels[0].imshow(gray, cmap="gray")
panels[0].set_title("photograph\n(not used)", fontsize=10)
for axes, name in zip(panels[1:], ("skimage 2x2", "opencv", "dalal_triggs"), strict=True):
    spec = candidates[name]
    descriptor = nablahog.from_layout(vector, spec, (128, 64))
    result = nablahog.reconstruct(descriptor, spec, (128, 64), quality="fast")
    axes.imshow(result.image, cmap="gray", vmin=0, vmax=1)
    axes.set_title(f"as {name}\ndistance {result.distance:.2f}", fontsize=10)
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# The distance is ‖φ(x) − d‖ / ‖d‖ of the pre-image x and the vector d. In OpenCV's order of numbers there is no
# picture: the vector is not OpenCV's. Dalal and Triggs's order is that of scikit-image, so picture and distance are
# nearly the same. The picture shows the order; for dialects with the same order the values decide, as in checks 2 and
# 3. All conventions of all libraries side by side: :doc:`/which_hog`.
