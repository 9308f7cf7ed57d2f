"""
You have a descriptor
=====================

A file from an old experiment holds HOG descriptors; the images are gone. This tutorial answers four questions: Which
HOG is it? Which image had it? How far can that pre-image be trusted? And what is lost for good?
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from skimage import data

import nablahog

# %%
# The file
# --------
# It contains an array and nothing else. (This cell makes the file for the tutorial.)

folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "features.npy"
photograph = np.array(Image.fromarray(data.astronaut()).crop((90, 0, 346, 256)).resize((128, 128)))
np.save(path, nablahog.hog(photograph, nablahog.presets.dpm(cell_size=8), layout="native"))

array = np.load(path)
print(f"{array.dtype}, shape {array.shape}, values {array.min():.4f} … {array.max():.4f}")

# %%
# Which HOG is it?
# ----------------
# **Count.** 32 channels are DPM's or Piotr Dollár's. 14x14 places are 16x16 cells without the outermost ones. So this
# may be DPM's, of an image of 128x128 pixels with cells of 8. The grids of all presets:

image_size = 128, 128
for name in nablahog.presets.__all__:
    preset = getattr(nablahog.presets, name)
    spec = preset(8) if name in ("seeing3d", "aubry") else preset()  # cells of 8 pixels, the default of the others
    shape = (*spec.grid(*image_size), spec.channels)
    mark = "  <- the shape of the file" if shape == array.shape else ""
    print(f"{name:13} rows, cols, channels {shape!s:14}{mark}")

# %%
# **Look at the values.** The last channel is all zeros. The largest entry is 0.4, half the sum of four entries that
# were clipped at 0.2. Of the four texture channels, the sum is a constant times the sum of the directed channels: this
# holds for DPM, dlib and Piotr Dollár, and only if the axes are in the right order.

directed, undirected, texture, last = np.split(array, [18, 27, 31], axis=2)
print(f"last channel all zero: {not last.any()}; largest directed entry: {directed.max():.4f}")
print(f"Σ texture − 0.2357 · 2 Σ directed, at most {abs(texture.sum(2) - 0.2357 * 2 * directed.sum(2)).max():.1e}")
print(f"Σ texture − 0.4714 · Σ undirected, at most {abs(texture.sum(2) - 0.4714 * undirected.sum(2)).max():.1e}")

# %%
# The first identity holds to rounding; the second one, VLFeat's, does not. So the file is DPM's. From here on we know
# the spec and the size of the image, and store them in a file together with the array.

spec = nablahog.presets.dpm(cell_size=8)
descriptor = nablahog.from_layout(array, spec, image_size)
nablahog.save_descriptor(path.with_suffix(".npz"), descriptor, spec, image_size)
stored = nablahog.load_descriptor(path.with_suffix(".npz"))
print(stored.spec, stored.image_size)

# %%
# Which image had it?
# -------------------
# ``reconstruct`` searches for an image with this descriptor. It begins with what a network for signed
# descriptors, which comes with the package, expects of photographs; the result still has to match the descriptor.
# ``prior=None`` searches without it.

plain = nablahog.reconstruct(descriptor, spec, image_size, prior=None, seed=0)
learned = nablahog.reconstruct(descriptor, spec, image_size, seed=0)

figure, panels = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained")
panels[0].imshow(nablahog.glyphs(descriptor, spec), cmap="gray")
panels[0].set_title("the descriptor as glyphs")
for axes, result, title in zip(panels[1:], (plain, learned), ("pre-image", "pre-image, learned prior"), strict=False):
    axes.imshow(result.image, cmap="gray", vmin=0, vmax=1)
    axes.set_title(f"{title},\ndistance {result.distance:.3f}", fontsize=10)
for result, label in ((plain, "nothing learned"), (learned, "learned prior")):
    panels[3].plot(result.history, label=label)
panels[3].set(yscale="log", xlabel="evaluations", ylabel="relative distance ‖φ(x) − d‖ / ‖d‖")
panels[3].legend(fontsize=9)
for axes in panels[:3]:
    axes.set_axis_off()
plt.show()

# %%
# The outermost ring of cells is dark in the glyphs: DPM leaves these cells out. Without the prior, the search first
# draws four samples of images with the recovered histograms. Then a second part of the curve begins, with the
# descriptor itself.
#
# How far can it be trusted?
# --------------------------
# The distance says how well the image explains the descriptor. It does not say whether the image is right, because many
# images have nearly this descriptor. Searches from different noise differ in what the descriptor does not determine:

images = torch.stack(
    [
        torch.from_numpy(
            nablahog.reconstruct(descriptor, spec, image_size, prior=None, quality="fast", seed=seed).image
        )
        for seed in range(4)
    ]
)
mean, deviation = images.mean(dim=0), images.std(dim=0)

figure, panels = plt.subplots(1, 4, figsize=(12, 3.2), layout="constrained")
for axes, k in zip(panels[:2], range(2), strict=True):
    axes.imshow(images[k], cmap="gray", vmin=0, vmax=1)
    axes.set_title(f"from the noise of seed {k}")
panels[2].imshow(mean, cmap="gray", vmin=0, vmax=1)
panels[2].set_title("mean of four")
shown = panels[3].imshow(deviation, cmap="magma", vmin=0, vmax=0.2)
panels[3].set_title("standard deviation of four")
figure.colorbar(shown, ax=panels[3], shrink=0.7, label="gray value, 0…1")
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# They differ most along strong edges, because the descriptor does not contain the position of an edge within its cell.
# Where they agree, the picture can still be wrong: all searches make the same assumptions.
#
# With a wrong order of the axes the search cannot explain the array, and the distance is large. With a wrong dialect of
# the same order it may be small. Here the array is also explained as Piotr Dollár's, of an image of 112x112 pixels:

transposed = np.ascontiguousarray(np.swapaxes(array, 0, 1))  # as MATLAB would store it
wrong = nablahog.presets.piotr(cell_size=8)
hypotheses = {
    "DPM": (descriptor, spec, image_size),
    "DPM, rows and columns exchanged": (transposed, spec, image_size),
    "Piotr Dollár": (nablahog.from_layout(array, wrong, (112, 112)), wrong, (112, 112)),
}
for name, (each, of, size) in hypotheses.items():
    result = nablahog.reconstruct(each, of, size, prior=None, quality="fast", seed=0)
    print(f"{name:32} distance {result.distance:.3f}")

# %%
# What is lost?
# -------------
# For this file we do have the photograph, so we can measure which frequencies the pre-image contains: the correlation
# of the Fourier coefficients, in rings of one cycle per image each. At 8 cycles per 128 pixels, half a wave is as long
# as a cell of 8 pixels.

gray = np.asarray(Image.fromarray(photograph).convert("L")) / 255


def by_frequency(image: NDArray[np.floating], reference: NDArray[np.floating]) -> NDArray[np.float64]:
    """Correlation of two images (N, N) in rings of 1, 2, … N/2 - 1 cycles per image."""
    window = np.outer(np.hanning(len(image)), np.hanning(len(image)))  # or the borders count as edges
    a, b = (np.fft.fft2((each - each.mean()) * window) for each in (image, reference))
    cycles = np.fft.fftfreq(len(image), 1 / len(image))
    ring = np.hypot(*np.meshgrid(cycles, cycles)).round().astype(int)
    result = []
    for k in range(1, len(image) // 2):
        first, second = a[ring == k], b[ring == k]
        result.append((first * second.conj()).real.sum() / np.linalg.norm(first) / np.linalg.norm(second))
    return np.array(result)


figure, panels = plt.subplots(1, 3, figsize=(12, 3.4), width_ratios=[1, 1, 1.7], layout="constrained")
panels[0].imshow(gray, cmap="gray", vmin=0, vmax=1)
panels[0].set_title("photograph")
panels[1].imshow(learned.image - gray, cmap="RdBu", vmin=-0.5, vmax=0.5)
panels[1].set_title("pre-image − photograph,\n−0.5 (red) … 0.5 (blue)", fontsize=10)
for result, label in ((plain, "nothing learned"), (learned, "learned prior")):
    correlation = nablahog.metrics.cross_correlation(gray, result.image)
    panels[2].plot(
        range(1, 64), by_frequency(result.image, gray), label=f"{label}, all frequencies: CC {correlation:.2f}"
    )
panels[2].axvline(8, color="0.6", linestyle="--")
panels[2].text(8.5, 0.02, "a cell is\nhalf a wave", fontsize=9)
panels[2].set(xlabel="cycles per image of 128 pixels", ylabel="correlation", ylim=(-0.1, 1), xlim=(1, 63))
panels[2].legend(fontsize=9)
for axes in panels[:2]:
    axes.set_axis_off()
plt.show()
folder.cleanup()

# %%
# Shapes as large as a few cells are kept. Finer details are mostly lost: the texture of the pre-image explains the
# votes, but so do many other textures. No HOG contains the brightness, and only Eq. 7 as printed contains the contrast.
#
# Where to go from here: :doc:`/which_hog` for all conventions, :doc:`/reconstruction` for how a pre-image is found, and
# :doc:`/templates` if the array is a detector's.
