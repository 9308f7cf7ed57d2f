"""How large do HOGLoss and its gradient become, over contrasts of the target and dialects?

    python benchmarks/loss.py

The images are a photograph and noise; the targets are flat but for noise of contrast 1 … 1e-6, or but for one pixel
that is one gray level off, or quite flat.  "Relative" is ‖φ(x) - φ(y)‖² / ‖φ(y)‖², the mean square of φ(x) where
φ(y) = 0.  Lengths of gradients are beside that for the photograph with a little noise and without.  A target's weight
is the loss of a flat image.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from skimage import data
from torch import Tensor

from nablahog import HOGLoss, hog
from nablahog.hog.dialects import DEFAULT_SPECS
from timing import table


def losses_and_lengths(loss: Callable[[Tensor, Tensor], Tensor], images: Tensor, targets: Tensor) -> Tensor:
    """Losses and lengths of gradients, (2, B), of pairs (B, 1, H, W)."""
    images = images.clone().requires_grad_()
    losses = loss(images, targets)
    (gradients,) = torch.autograd.grad(losses.sum(), images)
    return torch.stack([losses.detach(), gradients.flatten(1).norm(dim=1)])


def main() -> None:
    photograph = torch.from_numpy(data.camera()[100:228, 160:288])[None, None].double() / 255
    torch.manual_seed(0)
    noise, noisy = torch.rand_like(photograph), (photograph + 0.02 * torch.randn_like(photograph)).clamp(0, 1)
    flat, one_pixel = torch.full((2, *photograph.shape), 128 / 255, dtype=torch.float64)  # cnn_hog's gray beyond
    one_pixel[..., 60, 60] += 1 / 255
    contrasts = [flat + 10.0**-decades * (torch.rand_like(flat) - 0.5) for decades in range(7)]
    targets = torch.cat([*contrasts, one_pixel, flat]).repeat(2, 1, 1, 1)
    images = torch.cat([photograph, noise]).repeat_interleave(len(targets) // 2, 0)
    rows = []
    for name, spec in DEFAULT_SPECS.items():

        def relative(x: Tensor, target: Tensor, name: str = name) -> Tensor:
            expected = hog(target, name)
            size = expected.square().sum((1, 2, 3))
            return (hog(x, name) - expected).square().sum((1, 2, 3)) / size.where(size > 0, expected[0].numel())

        row, ours = [f"`{name}`"], HOGLoss(spec, reduction="none")
        for loss in (relative, ours):
            losses, lengths = losses_and_lengths(loss, images, targets)
            ordinary = losses_and_lengths(loss, noisy, photograph)[1]
            row += [f"{float(x):.2g}" for x in (losses.max(), losses[-1], lengths.max() / ordinary)]
        rows.append([*row, *(f"{float(ours(flat, contrasts[k])):.2g}" for k in (2, 4))])
    head = [f"{measure}{of}" for of in (", relative", "") for measure in ("loss", "target flat", "gradient")]
    print(table(["dialect", *head, "weight at 1e-2", "at 1e-4"], rows))


if __name__ == "__main__":
    main()
