"""The methods of Table 1.  A new one is one more entry of :data:`METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeAlias

from torch import Tensor

from ..hog import HOGSpec, hog, presets
from ..invert import LearnedPrior, reconstruct, reconstruct_multiscale, scale_descriptors
from ..invert.multiscale import SCALES, level_spec
from ..invert.start import enlarge
from .published import DALAL, PUBLISHED, UOCTTI, Published


@dataclass(frozen=True)
class Settings:
    """What a whole run has in common.

    Attributes:
        seed: of everything random.
        max_evaluations: of the objective, for each image; None for the method's own default.
        prior: the file of a learned prior, which methods that use one need; none comes with the package.
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
        uses_prior: whether it needs ``Settings.prior``.  Then what it finds depends on what that file holds.
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


def _multi_scale(image: Tensor, settings: Settings, *, spec: HOGSpec, more: bool) -> list[Found]:
    """The rows of a multi-scale method: its last level, and all of them enlarged to the image's size."""
    size = (image.shape[2], image.shape[3])
    for scale in SCALES:
        level_spec(spec, scale, size)  # raises before the work, not after
    descriptors = scale_descriptors(image, spec, SCALES) if more else hog(image, spec)
    found = reconstruct_multiscale(descriptors, spec, size, scales=SCALES, seed=settings.seed, **_limit(settings))
    levels = [
        Found(enlarge(level.found.image, *size)[0, 0].clamp(0, 1), float(level.found.distance[0])) for level in found
    ]
    return [levels[-1], *levels]


def _learned(image: Tensor, settings: Settings, *, spec: HOGSpec) -> list[Found]:
    if settings.prior is None:
        raise ValueError("this method needs a learned prior")
    size = (image.shape[2], image.shape[3])
    prior = load_prior(settings.prior)
    result = prior.reconstruct(hog(image, spec), spec, size, seed=settings.seed, **_limit(settings))
    return [Found(result.image[0, 0], float(result.distance[0]))]


def load_prior(path: Path) -> LearnedPrior:
    """The learned prior in a file, read once however many images it is used for.

    Raises:
        OSError, ValueError: as :meth:`LearnedPrior.load`.
    """
    state = path.stat() if path.exists() else None
    return _loaded(path, state and state.st_mtime_ns, state and state.st_size)


@lru_cache(maxsize=1)
def _loaded(path: Path, changed: int | None, size: int | None) -> LearnedPrior:
    return LearnedPrior.load(path)


def _variants(prefix: str, group: str, spec: HOGSpec) -> list[Method]:
    def several(more: bool) -> Run:
        return partial(_multi_scale, spec=spec, more=more)

    return [
        Method(f"{prefix}-single", group, partial(_single, spec=spec), spec),
        Method(f"{prefix}-multi-scale", group, several(False), spec, multiscale=True),
        Method(f"{prefix}-multi-scale-more", group, several(True), spec, multiscale=True),
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


def choose(names: Sequence[str] | None, *, with_prior: bool) -> tuple[list[Method], list[Method]]:
    """The methods to run, and those left out because they need a prior, each in the order of the table.

    Args:
        names: of those asked for; None for all that can run.
        with_prior: whether there is a learned prior.

    Raises:
        ValueError: one is asked for that needs a prior and there is none, or there is one that none asked for needs.
    """
    methods = [method for name, method in METHODS.items() if names is None or name in names]
    learned = [method for method in methods if method.uses_prior]
    if with_prior and not learned:
        of = ", ".join(method.name for method in METHODS.values() if method.uses_prior)
        raise ValueError(f"none of the methods asked for uses --prior; these do: {of}")
    if with_prior or not learned:
        return methods, []
    if names is not None:
        raise ValueError(f"{learned[0].name} needs --prior FILE, see `nablahog learn prior`")
    return [method for method in methods if not method.uses_prior], learned
