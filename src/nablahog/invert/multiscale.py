"""Section 3.1, multi-scale and multi-scale-more: small images first, each the start of a larger one.

A level of scale s has an s-th of the image's pixels, and cells of 1/√s of the side, so that its grid is the same.
*Multi-scale* matches the one descriptor at every level; *multi-scale-more* is given one of the original at each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Generic

import numpy as np
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..hog.descriptor import hog
from ..hog.inputs import Descriptors
from ..hog.spec import HOGSpec
from .histograms import recover_histograms
from .polarity import looks_negative, negated
from .preimage import (
    Reconstruction,
    Values,
    check_budget,
    check_descriptor,
    descriptors_as_tensor,
    of_the_kind,
    reconstruct,
    relative_distance,
)
from .quality import quality_of
from .start import enlarge, starting_images

SCALES = (64, 16, 4, 1)
BEFORE_THE_LAST = 120  # evaluations at most of an image at each level before


@dataclass(frozen=True)
class Level(Generic[Values]):
    """One level of a multi-scale reconstruction.

    Attributes:
        scale: s, the image's pixels over the level's.
        spec: the dialect with the level's cells.
        reconstruction: the pre-images of the level's size.
    """

    scale: int
    spec: HOGSpec
    reconstruction: Reconstruction[Values]


def level_spec(spec: HOGSpec, scale: int, image_size: tuple[int, int]) -> tuple[HOGSpec, tuple[int, int]]:
    """The spec and (height, width) of a level.

    Raises:
        ValueError: √s is no integer, or does not divide the cell and the image into whole pixels.
    """
    factor = math.isqrt(scale) if scale >= 1 else 0
    if factor < 1 or factor * factor != scale:
        raise ValueError(f"a scale must be a square number of at least 1, got {scale}")
    if any(n % factor for n in (*spec.cell_size, *image_size)):
        raise ValueError(
            f"an image of {image_size[0]}x{image_size[1]} pixels with cells of "
            f"{spec.cell_size[0]}x{spec.cell_size[1]} has no scale 1/{scale}: all must be multiples of {factor}"
        )
    cell = (spec.cell_size[0] // factor, spec.cell_size[1] // factor)
    return replace(spec, cell_size=cell), (image_size[0] // factor, image_size[1] // factor)


def scale_descriptors(image: Tensor, spec: HOGSpec, scales: Sequence[int] = SCALES) -> list[Tensor]:
    """What multi-scale-more is given: the descriptors (B, rows, cols, channels) of ``image`` at each scale.

    Args:
        image: (B, C, H, W) in 0…1.  A pixel of a level is the mean of those it covers.

    Raises:
        ValueError: a scale does not exist for this size.
    """
    levels = []
    for scale in scales:
        small, _ = level_spec(spec, scale, (image.shape[2], image.shape[3]))
        levels.append(hog(avg_pool2d(image, math.isqrt(scale)), small))
    return levels


def reconstruct_multiscale(
    descriptors: Descriptors | Sequence[Descriptors],
    spec: HOGSpec,
    image_size: tuple[int, int] | None = None,
    *,
    scales: Sequence[int] = SCALES,
    seed: int = 0,
    max_evaluations: int | None = None,
    closeness: float | None = None,
    polarity: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> list[Level[Descriptors]]:
    """Pre-images at every scale, the smallest first; the last is the answer.

    Of a signed spec, each level starts from what the one before found, enlarged, and draws samples of its own.  Of an
    unsigned one, samples that differ in the signs of regions would have no meaningful mean: the first level is a single
    image, and each later one expects what the one before found, keeps close to it, and adds what its pixels can say.

    Args:
        descriptors: (B, rows, cols, channels), matched at every level (multi-scale), or one for each scale
            (multi-scale-more, see :func:`scale_descriptors`).  Arrays as for :func:`.preimage.reconstruct`.
        spec: the dialect at the image's own size.
        image_size: (height, width); by default whole cells.
        scales: falling square numbers.
        seed: of the noise.
        max_evaluations: of an image at the last level, by default as :func:`.preimage.reconstruct`; each level before
            may spend a quarter of it and at most 120, "few iterations".
        closeness: to what a level expects, see :func:`.preimage.reconstruct`.
        polarity: whether, of an unsigned descriptor, the last level decides which of its image and the negative is the
            likelier, for all levels.
        progress: called with the evaluations done and the most there can be, over all levels.

    Raises:
        TypeError, ValueError: as :func:`.preimage.reconstruct`; the scales do not fall, or one does not exist for this
            image and cell size; there is not one descriptor for each.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), spec)
    >>> levels = nablahog.reconstruct_multiscale(descriptor, spec, scales=(4, 1), max_evaluations=10)
    >>> [tuple(level.reconstruction.image.shape) for level in levels]
    [(1, 1, 16, 16), (1, 1, 32, 32)]
    """
    more = not isinstance(descriptors, Tensor | np.ndarray)
    given = [descriptors] * len(scales) if isinstance(descriptors, Tensor | np.ndarray) else list(descriptors)
    several = [descriptors_as_tensor(descriptor) for descriptor in given]
    if not scales or any(a <= b for a, b in pairwise(scales)):
        raise ValueError(f"the scales must fall from level to level, got {tuple(scales)}")
    if len(several) != len(scales):
        raise ValueError(f"expected a descriptor for each of {len(scales)} scales, got {len(several)}")
    if max_evaluations is None:
        best = quality_of("best")
        max_evaluations = best.evaluations if spec.signed else best.without_samples
    check_budget(max_evaluations)
    size = image_size or check_descriptor(several[-1], spec, None)  # the grid is the same at each level
    plan = [level_spec(spec, scale, size) for scale in scales]
    for descriptor, level in zip(several, plan, strict=True):
        check_descriptor(descriptor, *(level if more else (spec, size)))
    budgets = [min(BEFORE_THE_LAST, max(2, max_evaluations // 4))] * (len(scales) - 1) + [max_evaluations]
    levels: list[Level] = []
    matched: list[Tensor] = []
    for scale, descriptor, (small, small_size), budget in zip(scales, several, plan, budgets, strict=True):
        options: dict[str, Any] = {"closeness": closeness, "polarity": False, **({} if spec.signed else {"samples": 1})}
        if levels:
            options["start" if spec.signed else "expected"] = enlarge(levels[-1].reconstruction.image, *small_size)
        elif not more:
            options["start"] = _first_start(descriptor, spec, size, small_size, seed)
        if not more and spec.normalizer.fixes_contrast:
            # at the same contrast, an s-th of the pixels with √s times the differences make 1/√s of the votes
            descriptor = descriptor / scale**0.25
        matched.append(descriptor)
        report = None if progress is None else _after(progress, sum(budgets[: len(levels)]), sum(budgets))
        found = reconstruct(
            descriptor, small, small_size, seed=seed, max_evaluations=budget, progress=report, **options
        )
        levels.append(Level(scale, small, found))
    if polarity and not spec.signed:
        levels = _upright(levels, matched)
    return [
        Level(level.scale, level.spec, of_the_kind(level.reconstruction, descriptor))
        for level, descriptor in zip(levels, given, strict=True)
    ]


def _after(progress: Callable[[int, int], None], before: int, most: int) -> Callable[[int, int], None]:
    """``progress`` over all levels, from within one: those before it had ``before`` evaluations, all have ``most``."""
    return lambda done, _: progress(before + done, most)


def _upright(levels: list[Level], descriptors: Sequence[Tensor]) -> list[Level]:
    """Each image or its negative: what the last level looks like, which shows most, decides for all."""
    negative = looks_negative(levels[-1].reconstruction.image)
    upright = []
    for level, descriptor in zip(levels, descriptors, strict=True):
        image = negated(level.reconstruction.image, negative)
        distance = relative_distance(image, descriptor, level.spec)
        upright.append(replace(level, reconstruction=replace(level.reconstruction, image=image, distance=distance)))
    return upright


def _first_start(
    descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], small_size: tuple[int, int], seed: int
) -> Tensor:
    """What the votes integrate to at full size, shrunk: cells of many pixels say so, whatever the level's own are."""
    starts = starting_images(recover_histograms(descriptor, spec, size), spec, *size, 1, seed)
    return avg_pool2d(starts[:, 0], size[0] // small_size[0])
