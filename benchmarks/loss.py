"""How large do HOGLoss and its gradient become, over strengths of noise and dialects?

    python benchmarks/loss.py

Noise is normal, and σ its standard deviation in units of the range of gray, on mid-gray.

1. Images are a photograph and noise; the targets are noise of σ 1e-1 … 1e-6, or flat but for one pixel that is one gray
   level off, or quite flat.  "Relative" is ‖φ(x) - φ(y)‖² / ‖φ(y)‖², the mean square of φ(x) where φ(y) = 0.
   Lengths of gradients are beside that for the photograph with a little noise and without.  A target's weight is the
   loss of a flat image.
2. The target is the photograph, and x is noise: the length of the gradient in the same units.
3. Descents from noise to the photograph: the loss afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from skimage import data
from torch import Tensor

from nablahog import HOGLoss, HOGSpec, hog
from nablahog.hog.dialects import DEFAULT_SPECS
from timing import table

WEIGHT_DECADES = (2, 3, 4)
START_DECADES = (1, 2, 3, 4, 6)
STEPS = 100


def losses_and_lengths(loss: Callable[[Tensor, Tensor], Tensor], images: Tensor, targets: Tensor) -> Tensor:
    """Losses and lengths of gradients, (2, B), of pairs (B, 1, H, W)."""
    images = images.clone().requires_grad_()
    losses = loss(images, targets)
    (gradients,) = torch.autograd.grad(losses.sum(), images)
    return torch.stack([losses.detach(), gradients.flatten(1).norm(dim=1)])


def descend(start: Tensor, target: Tensor, optimizer: type[torch.optim.Optimizer], clip: float, **settings: Any) -> str:
    """The loss after some steps, and the range of the image."""
    loss, image = HOGLoss("uoctti"), start.clone().requires_grad_()
    minimiser = optimizer([image], **settings)
    for _ in range(STEPS):
        minimiser.zero_grad()
        loss(image, target).backward()
        torch.nn.utils.clip_grad_norm_(image, clip)
        minimiser.step()
    result = image.detach()
    return f"{float(loss(result, target)):.2g} ({float(result.min()):.2g}…{float(result.max()):.2g})"


def main() -> None:
    photograph = torch.from_numpy(data.camera()[100:228, 160:288])[None, None].double() / 255
    torch.manual_seed(0)
    texture, noisy = torch.rand_like(photograph), (photograph + 0.02 * torch.randn_like(photograph)).clamp(0, 1)
    flat, one_pixel = torch.full((2, *photograph.shape), 128 / 255, dtype=torch.float64)  # cnn_hog's gray beyond
    one_pixel[..., 60, 60] += 1 / 255
    noise = {decades: flat + 10.0**-decades * torch.randn_like(flat) for decades in range(1, 7)}
    targets = torch.cat([*noise.values(), one_pixel, flat]).repeat(2, 1, 1, 1)
    images = torch.cat([photograph, texture]).repeat_interleave(len(targets) // 2, 0)
    starts = torch.cat([noise[decades] for decades in START_DECADES])
    rows, start_rows = [], []
    aubry = DEFAULT_SPECS["aubry"]
    larger = {"aubry, ε = 1": replace(aubry, normalizer=replace(aubry.normalizer, epsilon=1.0))}  # type: ignore[call-arg]
    for name, spec in sorted({**DEFAULT_SPECS, **larger}.items()):

        def relative(x: Tensor, target: Tensor, spec: HOGSpec = spec) -> Tensor:
            expected = hog(target, spec)
            size = expected.square().sum((1, 2, 3))
            return (hog(x, spec) - expected).square().sum((1, 2, 3)) / size.where(size > 0, expected[0].numel())

        row, ours = [f"`{name}`"], HOGLoss(spec, reduction="none")
        for loss in (relative, ours):
            losses, lengths = losses_and_lengths(loss, images, targets)
            ordinary = losses_and_lengths(loss, noisy, photograph)[1]
            row += [f"{float(x):.2g}" for x in (losses.max(), losses[-1], lengths.max() / ordinary)]
        rows.append([*row, *(f"{float(ours(flat, noise[decades])):.2g}" for decades in WEIGHT_DECADES)])
        lengths = losses_and_lengths(ours, starts, photograph.expand_as(starts))[1]
        start_rows.append([f"`{name}`", *(f"{float(length):.2g}" for length in lengths / ordinary)])
    head = [f"{measure}{of}" for of in (", relative", "") for measure in ("loss", "target flat", "gradient")]
    print(table(["dialect", *head, *(f"weight at σ 1e-{decades}" for decades in WEIGHT_DECADES)], rows))
    print(table(["dialect", *(f"x of σ 1e-{decades}" for decades in START_DECADES)], start_rows))
    descents = []
    for decades in START_DECADES:
        start, target = noise[decades].float(), photograph.float()
        descents.append(
            [
                f"1e-{decades}",
                descend(start, target, torch.optim.SGD, float("inf"), lr=1.0),
                descend(start, target, torch.optim.SGD, 1.0, lr=1.0),
                descend(start, target, torch.optim.Adam, float("inf"), lr=0.01),
            ]
        )
    print(table(["start of σ", "SGD", "SGD, gradients clipped", "Adam"], descents))


if __name__ == "__main__":
    main()
