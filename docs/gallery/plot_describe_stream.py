"""
The descriptor of an image larger than memory
=============================================

A scan of a map or a slide may have more pixels than fit into memory. ``nablahog.stream`` reads it in strips and yields
the rows of the descriptor of the whole image, with the same bits. The image is anything with ``shape``, ``dtype`` and
rows ``[start:stop]``: a ``numpy.memmap`` as here, a data set of HDF5 or Zarr.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle
from PIL import Image
from skimage import data

import nablahog

# %%
# A large image in a file
# -----------------------
# A mosaic of eight photographs. For the example it has 19 million pixels; a real one may have any number.

folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "mosaic.npy"
names = ("astronaut", "brick", "camera", "chelsea", "clock", "coffee", "coins", "rocket")
side = 1536
mosaic = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=(2 * side, 4 * side))
for k, name in enumerate(names):
    photograph = Image.fromarray(getattr(data, name)()).convert("L")
    square = min(photograph.size)
    part = photograph.crop((0, 0, square, square)).resize((side, side), Image.Resampling.BICUBIC)
    mosaic[k // 4 * side : (k // 4 + 1) * side, k % 4 * side : (k % 4 + 1) * side] = np.asarray(part)
mosaic.flush()
del mosaic

# %%
# Strip by strip
# --------------
# ``memory`` is the number of bytes that a strip may take, work space included. The descriptor is a mapped file, too.

image = np.load(path, mmap_mode="r")
spec = nablahog.presets.uoctti(cell_size=16)
rows, cols = spec.grid(*image.shape)
descriptor = np.lib.format.open_memmap(
    path.with_name("descriptor.npy"), mode="w+", dtype=np.float32, shape=(rows, cols, spec.channels)
)
limits = []
for place, strip in nablahog.stream(image, spec, memory=2**24):
    descriptor[place] = strip
    limits.append(place.stop)
print(f"image {image.shape[0]} x {image.shape[1]} pixels, {image.nbytes / 2**20:.0f} MiB")
print(f"descriptor {descriptor.shape}, {descriptor.nbytes / 2**20:.0f} MiB, in {len(limits)} strips of 16 MiB at most")

# %%
# The same bits as in one piece (this image still fits into memory, so that can be checked):

print("equal, bit by bit:", np.array_equal(descriptor, nablahog.hog(np.asarray(image), spec)))

# %%
# What was computed
# -----------------
# Left: the image, made 16 times smaller, with the limits of the strips. Middle: the share of a cell's votes that goes
# to its strongest orientation, ⅑ where all orientations are equally strong. Right: glyphs of the cells in the box.

undirected = descriptor[:, :, 18:27]
total = undirected.sum(axis=2)
share = undirected.max(axis=2) / np.where(total > 0, total, 1)
top, left, cells = 100, 196, 22
detail = nablahog.glyphs(descriptor[top : top + cells, left : left + cells], spec, cell_pixels=16)

figure, panels = plt.subplots(1, 3, figsize=(11, 3), width_ratios=[2, 2.3, 1.1], layout="constrained")
panels[0].imshow(image[8::16, 8::16], cmap="gray")
for limit in limits[:-1]:
    panels[0].axhline(limit - 0.5, color="cyan", linewidth=1)
panels[0].set_title(f"{len(limits)} strips of {image.shape[0]} x {image.shape[1]} pixels", fontsize=10)
shown = panels[1].imshow(share, cmap="magma", vmin=1 / 9, vmax=0.6)
panels[1].add_patch(Rectangle((left, top), cells, cells, fill=False, edgecolor="cyan", linewidth=1.5))
panels[1].set_title(f"strongest orientation of {rows} x {cols} cells", fontsize=10)
figure.colorbar(shown, ax=panels[1], shrink=0.7, label="share of the votes")
panels[2].imshow(detail, cmap="gray")
panels[2].set_title(f"glyphs of {cells} x {cells} cells", fontsize=10)
for axes in panels:
    axes.set_axis_off()
plt.show()
del image, descriptor, undirected
folder.cleanup()
