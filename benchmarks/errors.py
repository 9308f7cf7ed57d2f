"""Where the rest of the error is: signs of regions, and frequencies.

    python benchmarks/errors.py [--images DIR] [--every N] [--threads N]

The first table is about signs, which an unsigned descriptor does not hold.  CC is the correlation of the image found;
|CC| what it would be if somebody knew which of it and its negative is right; and the further columns what it would be
if somebody knew the sign of each window of so many pixels, Σ|covariance| / √(Σ variance · Σ variance) over windows,
each about its own mean, beside the same without knowing any, Σ covariance.

The second splits the image found (the better of it and its negative) into octaves of spatial frequency, and correlates
each with the same of the photograph.  *Share* is how much of the photographs' variance is in the octave.  With only the
octaves before it known perfectly, an image would reach the correlation in the last row.

The third asks what the levels of multi-scale look for, which are given the descriptor of the whole image: how far from
it the descriptor of the photograph itself is, shrunk to the level and at the contrast that suits best, and how far that
of the image found there.  Where the second is smaller, the level rightly prefers another image to the photograph.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, unfold

from nablahog import HOGSpec, hog, presets, reconstruct
from nablahog.invert.cosine_transform import cosines
from nablahog.invert.multiscale import SCALES, level_spec, reconstruct_multiscale, scale_descriptors
from photographs import photographs

WINDOWS = (64, 32, 16)
PERIODS = (256, 64, 32, 16, 8, 4, 1)  # pixels, the bounds of the octaves


def correlation(a: Tensor, b: Tensor) -> Tensor:
    """(B, …) twice to (B,)."""
    a, b = (x.flatten(1) - x.flatten(1).mean(dim=1, keepdim=True) for x in (a, b))
    size = a.norm(dim=1) * b.norm(dim=1)
    return torch.where(size > 0, (a * b).sum(dim=1) / size, 0)


def windowed(a: Tensor, b: Tensor, side: int) -> tuple[float, float]:
    """Mean correlation of what windows of ``side`` pixels hold about their means: with their signs, and without."""
    a, b = (unfold(x, side, stride=side).mT for x in (a, b))  # (B, windows, pixels)
    a, b = (x - x.mean(dim=2, keepdim=True) for x in (a, b))
    covariance = (a * b).sum(dim=2)
    size = (a.square().sum(dim=(1, 2)) * b.square().sum(dim=(1, 2))).sqrt().clamp(min=1e-12)
    return float((covariance.sum(dim=1) / size).mean()), float((covariance.abs().sum(dim=1) / size).mean())


def octaves(image: Tensor) -> list[Tensor]:
    """The cosine coefficients (B, n) of each octave, the mean in none."""
    height, width = image.shape[-2:]
    rows, cols = (cosines(n, image.dtype, image.device) for n in (height, width))
    coefficients = rows @ image @ cols.T
    y, x = (torch.arange(n, device=image.device) / (2 * n) for n in (height, width))  # cycles a pixel
    frequency = torch.hypot(y.unsqueeze(1), x)
    frequency[0, 0] = math.nan
    bounds = [1 / period for period in PERIODS]
    return [
        coefficients[..., (frequency > low) & (frequency <= high)].flatten(1)
        for low, high in zip([0.0, *bounds[1:-1]], bounds[1:], strict=True)
    ]


def distances_at_levels(images: Tensor, spec: HOGSpec) -> list[tuple[float, float]]:
    """Of each level of multi-scale: the mean distances of the shrunk photographs, and of what is found."""
    size = (images.shape[2], images.shape[3])
    descriptor = hog(images, spec)
    rows = []
    for level in reconstruct_multiscale(descriptor, spec, size):
        small, _ = level_spec(spec, level.scale, size)
        own = hog(avg_pool2d(images, math.isqrt(level.scale)), small).flatten(1)
        asked = (descriptor / level.scale**0.25 if spec.normalizer.fixes_contrast else descriptor).flatten(1)
        contrast = (own * asked).sum(dim=1, keepdim=True) / own.square().sum(dim=1, keepdim=True)
        distance = (contrast * own - asked).norm(dim=1) / asked.norm(dim=1)
        rows.append((float(distance.mean()), float(level.reconstruction.distance.mean())))
    return rows


def methods() -> dict[str, Callable[[Tensor], Tensor]]:
    def single(spec: HOGSpec) -> Callable[[Tensor], Tensor]:
        return lambda images: reconstruct(hog(images, spec), spec, (images.shape[2], images.shape[3])).image

    def levels(spec: HOGSpec, more: bool) -> Callable[[Tensor], Tensor]:
        def run(images: Tensor) -> Tensor:
            given = scale_descriptors(images, spec) if more else hog(images, spec)
            return reconstruct_multiscale(given, spec, (images.shape[2], images.shape[3]))[-1].reconstruction.image

        return run

    uoctti, paper = presets.uoctti(), presets.paper()
    return {
        "uoctti-single": single(uoctti),
        "dalal-single": single(paper),
        "dalal-multi-scale": levels(paper, False),
        "dalal-multi-scale-more": levels(paper, True),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of 128x128 images; by default those scikit-image installs")
    parser.add_argument("--every", type=int, default=1, help="only every Nth image")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    images = photographs(options.images)[:: options.every]
    result = {name: run(images) for name, run in methods().items()}

    print(f"{len(images)} images of {images.shape[2]}x{images.shape[3]}\n")
    columns = [f"{side} px" for side in WINDOWS]
    print(f"| signs | CC | abs CC | {' | '.join(f'{c}, its signs | {c}, best signs' for c in columns)} |")
    print(f"|---|{'---:|' * (2 + 2 * len(WINDOWS))}")
    for name, image in result.items():
        cc = correlation(image, images)
        row = [float(cc.mean()), float(cc.abs().mean())]
        for side in WINDOWS:
            row += windowed(image, images, side)
        print(f"| {name} | {' | '.join(f'{value:.3f}' for value in row)} |")

    true = octaves(images)
    power = torch.stack([c.square().sum(dim=1) for c in true])
    share = (power / power.sum(dim=0)).mean(dim=1)
    bounds = [f"{high:g}–{low:g} px" for high, low in pairwise(PERIODS)]
    print(f"\n| octave, period | {' | '.join([f'> {PERIODS[1]} px', *bounds[1:]])} |\n|---|{'---:|' * len(bounds)}")
    print(f"| share | {' | '.join(f'{float(s):.3f}' for s in share)} |")
    for name, image in result.items():
        sign = torch.sign(correlation(image, images)).reshape(-1, 1, 1, 1)
        each = [correlation(a, b) for a, b in zip(octaves(image * sign), true, strict=True)]
        print(f"| {name} | {' | '.join(f'{float(c.mean()):.3f}' for c in each)} |")
    known = (power.cumsum(dim=0) / power.sum(dim=0)).sqrt().mean(dim=1)
    print(f"| up to here perfect, CC | {' | '.join(f'{float(c):.3f}' for c in known)} |")

    print(f"\n| distance at | {' | '.join(f'1/{scale}' for scale in SCALES)} |\n|---|{'---:|' * len(SCALES)}")
    for preset in ("uoctti", "paper"):
        levels = distances_at_levels(images, getattr(presets, preset)())
        for who, column in (("the photograph itself", 0), ("what multi-scale finds", 1)):
            print(f"| {preset}, {who} | {' | '.join(f'{row[column]:.3f}' for row in levels)} |")


if __name__ == "__main__":
    main()
