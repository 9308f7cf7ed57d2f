"""
Inverting the HOG of OpenCV, dlib and DPM
=========================================

Descriptors of other libraries have their own shapes and orders. ``from_layout`` brings them to rows, columns and
channels, and ``reconstruct`` inverts them.
"""

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from skimage import data

import nablahog

SIZE = 128, 128
PLACES = {"astronaut": (90, 0, 346, 256), "coffee": (150, 20, 500, 370), "chelsea": (60, 10, 340, 290)}
photographs = {
    name: np.array(Image.fromarray(getattr(data, name)()).crop(box).resize(SIZE)) for name, box in PLACES.items()
}

# %%
# Arrays as the libraries return them
# -----------------------------------
# The example does not need the libraries: it computes the arrays itself, in the layout of each library. The tests
# compare these arrays with stored outputs of the libraries.

dialects = {
    "OpenCV": nablahog.presets.opencv(win_size=(128, 128)),  # cv2.HOGDescriptor(…).compute(image)
    "dlib": nablahog.presets.dlib(cell_size=8),  # dlib.extract_fhog_features
    "DPM": nablahog.presets.dpm(cell_size=8),  # features.cc of voc-release5, also in HOGgles
}
arrays = {
    (name, library): nablahog.hog(photograph, spec, layout="native")
    for name, photograph in photographs.items()
    for library, spec in dialects.items()
}
for library, spec in dialects.items():
    kind = f"{spec.bins} {'signed' if spec.signed else 'unsigned'} orientation bins"
    print(f"{library:7} {arrays['astronaut', library].shape!s:13} {kind}")

# %%
# Invert
# ------
# The descriptors of one library are one batch. ``reconstruct`` uses the networks that come with the package, which know
# what photographs look like; with ``prior=None`` nothing is learned.

figure, panels = plt.subplots(3, 4, figsize=(10, 8.2), layout="constrained")
for row, (name, photograph) in zip(panels, photographs.items(), strict=True):
    row[0].imshow(photograph)
    row[0].set_title(f"{name}, {SIZE[0]}x{SIZE[1]} pixels", fontsize=10)
for col, (library, spec) in enumerate(dialects.items(), start=1):
    native = np.stack([arrays[name, library] for name in photographs])
    descriptors = nablahog.from_layout(native, spec, SIZE)
    results = nablahog.reconstruct(descriptors, spec, SIZE, quality="fast", seed=0)
    for row, photograph, image, distance in zip(
        panels, photographs.values(), results.image, results.distance, strict=True
    ):
        gray = np.asarray(Image.fromarray(photograph).convert("L"))
        correlation = nablahog.metrics.cross_correlation(gray, image)
        row[col].imshow(image, cmap="gray", vmin=0, vmax=1)
        row[col].set_title(f"{library}: CC {correlation:.2f}, distance {distance:.2f}", fontsize=10)
for axes in panels.flat:
    axes.set_axis_off()
plt.show()

# %%
# CC is the correlation of the pre-image with the gray photograph, and the distance is ‖φ(x) − d‖ / ‖d‖. dlib and DPM
# leave out the outermost cells, so the 8 pixels at the border are a guess. OpenCV's bins are unsigned: which
# side of an edge is bright must be guessed, too.
