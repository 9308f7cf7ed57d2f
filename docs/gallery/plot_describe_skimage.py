"""
From scikit-image to PyTorch by one import
==========================================

A program calls ``skimage.feature.hog``, and now needs the same descriptor for tensors, with a derivative. Change the
import; the arguments and the numbers stay the same.
"""

import matplotlib.pyplot as plt
import numpy as np
import skimage.feature
import torch
from PIL import Image
from skimage import data

import nablahog
from nablahog.compat.skimage import hog  # was: from skimage.feature import hog

image = np.array(Image.fromarray(data.camera()).crop((100, 40, 356, 296)).resize((128, 128)))

theirs, their_picture = skimage.feature.hog(image, orientations=8, cells_per_block=(2, 2), visualize=True)
ours, our_picture = hog(image, orientations=8, cells_per_block=(2, 2), visualize=True)
print(f"{ours.size} numbers, the largest difference is {np.abs(ours - theirs).max():.1e}")

# %%
# Tensors have a derivative
# -------------------------
# A tensor gives a tensor, on its device and in its graph. Here is the derivative of one number: the vote of the block
# in the middle, its first cell, for horizontal gradients.

tensor = torch.from_numpy(image / 255).requires_grad_()
descriptor = hog(tensor, orientations=8, cells_per_block=(2, 2), feature_vector=False)
row, col = 4, 6
descriptor[row, col, 0, 0, 0].backward()
derivative = tensor.grad
assert derivative is not None
print(f"descriptor {tuple(descriptor.shape)}, pixels with a derivative: {int((derivative != 0).sum())}")

figure, panels = plt.subplots(1, 4, figsize=(10, 3), layout="constrained")
panels[0].imshow(image, cmap="gray")
panels[0].set_title("image, 128x128 pixels")
panels[1].imshow(their_picture, cmap="gray")
panels[1].set_title("scikit-image's picture")
panels[2].imshow(our_picture, cmap="gray")
panels[2].set_title("the same by ∇HOG")
limit = float(derivative.abs().max())
shown = panels[3].imshow(derivative, cmap="RdBu", vmin=-limit, vmax=limit)
panels[3].set(xlim=(8 * col - 4, 8 * col + 20), ylim=(8 * row + 20, 8 * row - 4))
panels[3].set_title("derivative of one entry,\n24x24 pixels around its block", fontsize=10)
figure.colorbar(shown, ax=panels[3], shrink=0.7, label="entry / gray value")
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# All 16x16 pixels of the block, and one more pixel around them, have a derivative. The pixels of the cell vote; the
# others change the length by which the votes are divided.
#
# Batches
# -------
# scikit-image takes one image. ``nablahog.hog`` takes a batch, and ``layout="native"`` gives scikit-image's vectors.
# Pass the ``uint8`` image if every digit counts: in 0…1, rounding decides the bin of a gradient that lies between two
# bins.

spec = nablahog.presets.skimage(orientations=8, cells_per_block=(2, 2))
batch = torch.from_numpy(np.stack([image, image[::-1], image[:, ::-1]]))[:, None]  # (B, C, H, W)
vectors = nablahog.hog(batch, spec, layout="native")
print(f"a batch {tuple(batch.shape)} gives {tuple(vectors.shape)}")
print(f"the largest difference from scikit-image is {np.abs(vectors[0].numpy() - theirs).max():.1e}")
