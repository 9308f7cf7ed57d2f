"""
You have a network to train
===========================

HOG can be a layer, a target or a loss. This tutorial puts it into a network, checks its gradient, and looks at batches,
speed, ``torch.compile`` and autocast.
"""

import time
from collections.abc import Callable

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data
from skimage.feature import hog as skimage_hog
from torch import Tensor, nn
from torch.nn.functional import conv2d, cross_entropy

import nablahog

# %%
# A layer
# -------
# ``nablahog.HOG`` is a module without parameters. Images are (B, C, H, W) in 0…1, or ``uint8``; descriptors are
# (B, rows, cols, channels).

layer = nablahog.HOG(nablahog.presets.uoctti(cell_size=8))
images = torch.rand(4, 3, 64, 64, generator=torch.Generator().manual_seed(0))
print(layer(images).shape, "and in the library's own order:", nablahog.HOG("vlfeat", layout="native")(images).shape)

# %%
# The images of a batch do not influence each other. The layer has no batch statistics and no state:

print("one image alone is the same:", torch.equal(layer(images)[2:3], layer(images[2:3])))

# %%
# Is the gradient right?
# ----------------------
# ``gradcheck`` compares the derivative of every entry by every pixel with central differences, in float64. Choose a
# spec with linear votes: hard votes jump between bins, and their derivative is that of the magnitude alone
# (:doc:`/derivatives`).

small = torch.rand(1, 1, 16, 16, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
for name, spec in {
    "uoctti": nablahog.presets.uoctti(cell_size=8),
    "paper": nablahog.presets.paper(cell_size=8),
}.items():
    print(name, torch.autograd.gradcheck(lambda x, spec=spec: nablahog.hog(x, spec), small))

# %%
# It is never NaN, not even where a flat image divides 0 by 0:

flat = torch.full((1, 1, 16, 16), 0.5, requires_grad=True)
(gradient,) = torch.autograd.grad(layer(flat).sum(), flat)
print("gradient of a flat image, finite:", bool(gradient.isfinite().all()))

# %%
# Train through it
# ----------------
# The images are procedural chairs from four sides, with strong noise. The network is one filter of 7x7 pixels, the HOG,
# and a linear classifier. The gradient of the filter goes through the HOG, so the filter can be learned, too.

SIDE, VIEWS = 48, ("front", "left", "back", "right")
generator = np.random.default_rng(0)
camera = nablahog.Camera.from_field_of_view(30, SIDE, SIDE)


def renderings(meshes: list[nablahog.Mesh]) -> tuple[Tensor, Tensor]:
    """Each chair from the four sides: images (4 N, 1, SIDE, SIDE), and views (4 N,)."""
    result = []
    for mesh in meshes:
        azimuths = 90.0 * np.arange(4) + generator.uniform(-30, 30, 4)
        poses = torch.from_numpy(
            np.stack([azimuths, generator.uniform(5, 25, 4), *np.tile([[2.4], [0], [0], [0]], 4)], 1)
        )
        result.append(nablahog.render(mesh, poses, camera, supersampling=2))
    return torch.cat(result), torch.arange(4).repeat(len(meshes))


meshes = list(nablahog.sample_chairs().values())
clean, views = renderings(3 * [mesh for k, mesh in enumerate(meshes) if k % 4])
test_clean, test_views = renderings(4 * meshes[::4])
noise = torch.Generator().manual_seed(0)


def noisy(images: Tensor) -> Tensor:
    """Images with normal noise of σ = 0.3, cut off at black and white."""
    return (images + 0.3 * torch.randn(images.shape, generator=noise)).clamp(0, 1)


class Classifier(nn.Module):
    """Filter, HOG, linear classifier of the four views."""

    def __init__(self, spec: nablahog.HOGSpec) -> None:
        super().__init__()
        rows, cols = spec.grid(SIDE, SIDE)
        self.filter = nn.Parameter(torch.zeros(1, 1, 7, 7))
        self.filter.data[0, 0, 3, 3] = 1  # at first it changes nothing
        self.hog = nablahog.HOG(spec)
        self.head = nn.Linear(rows * cols * spec.channels, len(VIEWS))

    def forward(self, images: Tensor) -> Tensor:
        scores: Tensor = self.head(self.hog(self.filtered(images)).flatten(1))
        return scores

    def filtered(self, images: Tensor) -> Tensor:
        """The images after the filter, whose weights are scaled so that their magnitudes sum to 1."""
        return conv2d(images, self.filter / self.filter.abs().sum(), padding=3)


def train(learn_filter: bool) -> tuple[Classifier, list[float]]:
    """The classifier after 200 steps, and its accuracy on other chairs after every ten."""
    torch.manual_seed(0)
    network = Classifier(nablahog.presets.uoctti(cell_size=8))
    network.filter.requires_grad_(learn_filter)
    groups = [{"params": [network.head.weight, network.head.bias], "lr": 1e-3}]
    if learn_filter:
        groups.append({"params": [network.filter], "lr": 5e-3})
    optimizer = torch.optim.AdamW(groups, weight_decay=0.1)
    accuracies = []
    test_images = noisy(test_clean)
    for step in range(200):
        chosen = torch.from_numpy(generator.integers(0, len(clean), 64))
        loss = cross_entropy(network(noisy(clean[chosen])), views[chosen])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 10 == 9:
            with torch.no_grad():
                accuracies.append(float((network(test_images).argmax(1) == test_views).float().mean()))
    return network, accuracies


fixed, fixed_accuracies = train(learn_filter=False)
learned, learned_accuracies = train(learn_filter=True)
print(f"accuracy on 10 other chairs from 4 sides: filter fixed {fixed_accuracies[-1]:.0%}, ", end="")
print(f"filter learned {learned_accuracies[-1]:.0%}, by chance 25%")

figure, panels = plt.subplots(1, 4, figsize=(12, 3), width_ratios=[1, 1, 1.1, 1.5], layout="constrained")
example = noisy(test_clean[1:2])
with torch.no_grad():
    filtered = learned.filtered(example)
panels[0].imshow(example[0, 0], cmap="gray")
panels[0].set_title(f"image with noise,\n{SIDE}x{SIDE} pixels", fontsize=10)
panels[1].imshow(filtered[0, 0], cmap="gray")
panels[1].set_title("after the learned filter", fontsize=10)
kernel = (learned.filter / learned.filter.abs().sum()).detach()[0, 0]
limit = float(kernel.abs().max())
shown = panels[2].imshow(kernel, cmap="RdBu", vmin=-limit, vmax=limit)
panels[2].set_title("learned filter, 7x7", fontsize=10)
figure.colorbar(shown, ax=panels[2], shrink=0.7)
for accuracies, label in ((fixed_accuracies, "filter fixed"), (learned_accuracies, "filter learned")):
    panels[3].plot(range(10, 201, 10), accuracies, label=label)
panels[3].set(xlabel="steps", ylabel="accuracy on other chairs", ylim=(0, 1))
panels[3].legend(loc="lower right")
for axes in panels[:3]:
    axes.set_axis_off()
plt.show()

# %%
# Speed
# -----
# Best of five runs on one thread of the machine that built this page, in milliseconds for an image of 256x256 pixels.
# Timings of other machines and libraries, measured with more care: :doc:`/performance`.

torch.set_num_threads(1)
photograph = np.array(Image.fromarray(data.astronaut()).convert("L").resize((256, 256)))
batch = (torch.from_numpy(photograph) / 255).expand(16, 1, 256, 256).contiguous()


def milliseconds(function: Callable[[], object], images: int) -> float:
    """Wall time for an image, the least of five runs after a first one."""
    function()
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return 1000 * min(times) / images


def forward_and_backward() -> None:
    """The descriptor of the batch, and the gradient of a sum of squares."""
    leaf = batch.detach().requires_grad_()
    nablahog.hog(leaf, layer.spec).square().sum().backward()


with torch.no_grad():
    timings = {
        "skimage.feature.hog": milliseconds(lambda: skimage_hog(photograph), 1),
        "∇HOG, the same descriptor": milliseconds(lambda: nablahog.hog(batch, "skimage"), 16),
        "∇HOG, uoctti": milliseconds(lambda: nablahog.hog(batch, layer.spec), 16),
    }
timings["∇HOG, uoctti, with backward"] = milliseconds(forward_and_backward, 16)
for name, value in timings.items():
    print(f"{name:28} {value:7.3f} ms an image")

# %%
# torch.compile
# -------------
# HOG is one operator in the graph, without a break, also inside a compiled network. ``backend="aot_eager"`` needs no
# compiler of C++; leave it out for PyTorch's default.

compiled = torch.compile(fixed, backend="aot_eager", fullgraph=True)
with torch.no_grad():
    print("largest difference:", float((compiled(example) - fixed(example)).abs().max()))

# %%
# Autocast
# --------
# Convolutions and products of matrices run in bfloat16. HOG computes in float32 and leaves its result there, as
# PyTorch's own normalisations do; the classifier after it takes bfloat16 again.

with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
    half = fixed.filtered(example)
    print(f"the filter returns {half.dtype}, HOG {layer(half).dtype}, the network {fixed(example).dtype}")

# %%
# Without autocast, float16 and bfloat16 images give descriptors of their own dtype, computed in float32:

print(layer(images.to(torch.bfloat16)).dtype)

# %%
# Where to go from here: :ref:`sphx_glr_auto_gallery_plot_train_loss.py` for HOG beside another loss,
# :ref:`sphx_glr_auto_gallery_plot_train_maskfeat.py` for HOG as a target, and :doc:`/derivatives` for what happens at
# kinks, library by library.
