"""The methods of Table 1.  A new one is one more entry of :data:`METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import torch
from torch import Tensor
from torch.nn import functional

from ..hog import HOGSpec, hog, presets
from ..invert import reconstruct
from .published import DALAL, PUBLISHED, UOCTTI, Published

SCALES = (64, 16, 4, 1)  # a level of scale s has an s-th of the image's pixels


@dataclass(frozen=True)
class Settings:
    """What a whole run has in common.

    Attributes:
        seed: of everything random.
        max_evaluations: of the objective, for each image; None for the method's own default.
        prior: the file of a learned prior, for methods that use one; None for the one that comes with the package.
    """

    seed: int = 0
    max_evaluations: int | None = None
    prior: Path | None = None


@dataclass(frozen=True)
class Found:
    """What a method found: an image (H, W), float in 0…1, of the original's size, and ‖φ(image) − d‖ / ‖d‖."""

    image: Tensor
    distance: float


Run: TypeAlias = Callable[[Tensor, Settings], Sequence[Found]]


@dataclass(frozen=True)
class Method:
    """A method of the table.

    Attributes:
        name: unique.
        group: what it starts from, one of :data:`.published.GROUPS`.
        run: from an image (1, 1, H, W), float32 in 0…1, to one finding for each of ``rows``, in order.  It depends on
            nothing but its arguments, and raises ValueError with one sentence for an image it cannot take.  Worker
            processes import it, so it is a function of a module, or a ``functools.partial`` of one.
        spec: the dialect of the descriptor it starts from; None if that is no HOG.
        multiscale: whether it has a row for each of :data:`SCALES`, too.
        uses_prior: whether ``Settings.prior`` changes what it finds.
    """

    name: str
    group: str
    run: Run
    spec: HOGSpec | None = None
    multiscale: bool = False
    uses_prior: bool = False

    @property
    def levels(self) -> tuple[str, ...]:
        """The rows of its levels, from the smallest: ``NAME@1/64`` … ``NAME@1/1``."""
        return tuple(f"{self.name}@1/{scale}" for scale in SCALES) if self.multiscale else ()

    @property
    def rows(self) -> tuple[str, ...]:
        """Its rows of the table: its name, which stands for the last level if it has levels, and these."""
        return (self.name, *self.levels)

    @property
    def paper(self) -> dict[str, Published]:
        """The published figures of its rows, of those that have any."""
        return {row: PUBLISHED[row] for row in self.rows if row in PUBLISHED}


def _limit(settings: Settings) -> dict[str, Any]:
    return {} if settings.max_evaluations is None else {"max_evaluations": settings.max_evaluations}


def _single(image: Tensor, settings: Settings, *, spec: HOGSpec) -> list[Found]:
    size = (image.shape[2], image.shape[3])
    result = reconstruct(hog(image, spec), spec, size, seed=settings.seed, **_limit(settings))
    return [Found(result.image[0, 0], float(result.distance[0]))]


@dataclass(frozen=True)
class Level:
    """STUB of a level: scale, image (1, 1, h, w) and distance (1,)."""

    scale: int
    image: Tensor
    distance: Tensor


def _multi_scale(image: Tensor, settings: Settings, *, spec: HOGSpec) -> list[Level]:
    """STUB: the single scale, shrunk."""
    height, width = image.shape[2:]
    if height % 8 or width % 8:
        raise ValueError(f"expected sides that are multiples of 8, so that there is a scale 1/64, got {height}x{width}")
    (found,) = _single(image, settings, spec=spec)
    whole, distance = found.image[None, None], torch.tensor([found.distance])
    return [Level(s, functional.avg_pool2d(whole, round(s**0.5)), distance) for s in SCALES]


_multi_scale_more = _multi_scale  # STUB


def _learned(image: Tensor, settings: Settings, *, spec: HOGSpec) -> list[Found]:
    """STUB: the single scale, without the prior."""
    return _single(image, settings, spec=spec)


LevelsRun: TypeAlias = Callable[..., Sequence[Level]]


def _levels(image: Tensor, settings: Settings, *, spec: HOGSpec, run: LevelsRun) -> list[Found]:
    """The rows of a multi-scale method: its last level, and all of them enlarged to the image's size."""
    levels = [
        Found(_enlarged(level.image, image.shape[2:])[0, 0], float(level.distance[0]))
        for level in run(image, settings, spec=spec)
    ]
    return [levels[-1], *levels]


def _enlarged(image: Tensor, size: torch.Size) -> Tensor:
    if image.shape[2:] == size:
        return image
    return functional.interpolate(image, list(size), mode="bicubic", align_corners=False).clamp(0, 1)


def _variants(prefix: str, group: str, spec: HOGSpec) -> list[Method]:
    def several(run: LevelsRun) -> Run:
        return partial(_levels, spec=spec, run=run)

    return [
        Method(f"{prefix}-single", group, partial(_single, spec=spec), spec),
        Method(f"{prefix}-multi-scale", group, several(_multi_scale), spec, multiscale=True),
        Method(f"{prefix}-multi-scale-more", group, several(_multi_scale_more), spec, multiscale=True),
    ]


METHODS = {
    method.name: method
    for method in (
        *_variants("uoctti", UOCTTI, presets.uoctti()),
        Method("uoctti-learned", UOCTTI, partial(_learned, spec=presets.uoctti()), presets.uoctti(), uses_prior=True),
        *_variants("dalal", DALAL, presets.paper()),
    )
}
"""All methods by name, each group in the order of the table."""
