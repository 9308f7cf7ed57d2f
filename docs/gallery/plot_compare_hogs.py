"""
How far apart are two HOGs?
===========================

Two libraries return different numbers for one photograph. Glyphs have one form for all HOGs: in each cell, a stroke for
each orientation, as bright as its histogram. So the glyphs of two HOGs with cells of one size can be subtracted.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from skimage import data

import nablahog

photograph = Image.fromarray(data.astronaut()).resize((256, 256))
opencv, skimage = nablahog.presets.opencv(), nablahog.presets.skimage(cells_per_block=(2, 2), channel_axis=-1)


def drawn(spec: nablahog.HOGSpec) -> np.ndarray:
    """The glyphs of the photograph, scaled to length 1."""
    glyphs = nablahog.glyphs(nablahog.hog(photograph, spec), spec, 16)
    return np.asarray(glyphs / np.linalg.norm(glyphs))


# %%
# Where they differ
# -----------------
# The heat map shows the distance of the glyphs in each cell of 8x8 pixels.

ours, theirs = drawn(opencv), drawn(skimage)
rows, cols = (side // 16 for side in ours.shape)
distances = np.sqrt(((ours - theirs) ** 2).reshape(rows, 16, cols, 16).sum(axis=(1, 3)))

figure, panels = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained")
for axes, picture, title in zip(
    panels,
    (photograph, ours, theirs, distances),
    ("photograph", "opencv", "skimage 2x2", "distance by cell"),
    strict=True,
):
    drawing = axes.imshow(picture, cmap="magma" if picture is distances else "gray")
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()
figure.colorbar(drawing, ax=panels[3])
plt.show()

# %%
# Why they differ
# ---------------
# A spec names its conventions. Those of OpenCV are replaced by those of scikit-image, one after another. Each step
# shows what a convention contributes. What remains, such as ties of colours, is too small to see.

spec = opencv
print(f"as they are          distance {np.linalg.norm(ours - theirs):.3f}; 0: equal, 1.41: nothing in common")
for names in (["gamma"], ["vote"], ["normalizer", "pooling"]):
    spec = replace(spec, **{name: getattr(skimage, name) for name in names})
    print(f"{', '.join(names):20} distance {np.linalg.norm(drawn(spec) - theirs):.3f}")
