"""The methods of Table 1.  A new one is an entry of :data:`METHODS`, and its name in :mod:`.names`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from torch import Tensor

from ..hog import HOGSpec, hog, presets
from ..invert import AsPublished, Reconstruction, Search, reconstruct, reconstruct_multiscale, scale_descriptors
from ..invert.histograms import searchable
from ..invert.multiscale import SCALES, level_spec
from ..invert.start import enlarge
from ..jobs.job_files import local_path
from .baselines.cnn_hog import CNNHOG
from .baselines.triangles import TRIANGLES, reconstruct_by_triangles
from .learned import SPEC, load
from .names import DALAL, DIALECTS, LEARNED_DIALECTS, LIBRARIES, NO_HOG, TAKES_HOURS, UOCTTI


@dataclass(frozen=True)
class Table1Settings:
    """The settings of all methods of a run.

    Attributes:
        seed: of everything random.
        max_evaluations: of the objective, for each image; None for the method's own default.
        learned: files that methods learned from photographs, by the names of :data:`.LEARNED`.
    """

    seed: int = 0
    max_evaluations: int | None = None
    learned: Mapping[str, Path] = field(default_factory=dict)


@dataclass(frozen=True)
class MethodOutput:
    """An image (H, W), float in 0…1, of the original's size, and its distance ‖φ(image) − d‖ / ‖d‖."""

    image: Tensor
    distance: float


Run: TypeAlias = Callable[[Tensor, Table1Settings], Sequence[MethodOutput]]


@dataclass(frozen=True)
class Method:
    """A method of the table.

    Attributes:
        name: unique.
        group: its kind of input, one of :data:`.names.GROUPS`.
        run: from an image (1, 1, H, W), float32 in 0…1, to one output for each of ``rows``, in order.  It depends on
            nothing but its arguments, and raises ValueError with one sentence for an image it cannot take.  Worker
            processes import it, so it is a function of a module, or a ``functools.partial`` of one.
        spec: the dialect of its input descriptor; None if that is no HOG.
        multiscale: whether it also has a row for each of :data:`SCALES`.
        needs: the kinds of learned files that it reads, keys of ``Table1Settings.learned``; the first is for
            descriptors of ``spec``.
        asked: whether it runs only if it is asked for by name.
    """

    name: str
    group: str
    run: Run
    spec: HOGSpec | None = None
    multiscale: bool = False
    needs: tuple[str, ...] = ()
    asked: bool = False

    @property
    def levels(self) -> tuple[str, ...]:
        """The rows of its levels, from the smallest: ``NAME@1/64`` … ``NAME@1/1``."""
        return tuple(f"{self.name}@1/{scale}" for scale in SCALES) if self.multiscale else ()

    @property
    def rows(self) -> tuple[str, ...]:
        """Its rows of the table: its name, which stands for the last level if it has levels, and these."""
        return (self.name, *self.levels)


def _options(settings: Table1Settings) -> dict[str, Any]:
    return {"seed": settings.seed, "search": Search(max_evaluations=settings.max_evaluations)}


def _published_options(settings: Table1Settings) -> dict[str, Any]:
    return {"seed": settings.seed, "method": AsPublished(max_evaluations=settings.max_evaluations)}


def _inverted(
    invert: Callable[..., Reconstruction], image: Tensor, spec: HOGSpec, **options: Any
) -> list[MethodOutput]:
    """What ``invert`` makes of the descriptor of an image."""
    result = invert(hog(image, spec), spec, (image.shape[2], image.shape[3]), **options)
    return [MethodOutput(result.image[0, 0], float(result.distance[0]))]


def _single(image: Tensor, settings: Table1Settings, *, spec: HOGSpec) -> list[MethodOutput]:
    return _inverted(reconstruct, image, spec, **_options(settings))


def _multi_scale(image: Tensor, settings: Table1Settings, *, spec: HOGSpec, more: bool) -> list[MethodOutput]:
    return _levels(image, spec, more, **_options(settings))


def _paper_single(image: Tensor, settings: Table1Settings, *, spec: HOGSpec) -> list[MethodOutput]:
    return _inverted(reconstruct, image, spec, **_published_options(settings))


def _paper_multi_scale(image: Tensor, settings: Table1Settings, *, spec: HOGSpec, more: bool) -> list[MethodOutput]:
    return _levels(image, spec, more, **_published_options(settings))


def _levels(image: Tensor, spec: HOGSpec, more: bool, **options: Any) -> list[MethodOutput]:
    """The rows of a multi-scale method: its last level, and all of them enlarged to the image's size."""
    size = (image.shape[2], image.shape[3])
    for scale in SCALES:
        level_spec(spec, scale, size)  # raises before the work, not after
    descriptors = scale_descriptors(image, spec, SCALES) if more else hog(image, spec)
    results = reconstruct_multiscale(descriptors, spec, size, scales=SCALES, **options)
    levels = []
    for result in (level.reconstruction for level in results):
        enlarged = enlarge(result.image, *size)[0, 0].clamp(0, 1)
        levels.append(MethodOutput(enlarged, float(result.distance[0])))
    return [levels[-1], *levels]


def _learned(image: Tensor, settings: Table1Settings, *, kind: str, spec: HOGSpec) -> list[MethodOutput]:
    return _inverted(_needed(kind, settings).reconstruct, image, spec)


def _with_prior(image: Tensor, settings: Table1Settings, *, kinds: Sequence[str], spec: HOGSpec) -> list[MethodOutput]:
    priors = [_needed(kind, settings) for kind in kinds]
    return _inverted(reconstruct, image, spec, prior=priors, **_options(settings))


def _multi_scale_more_with_prior(
    image: Tensor, settings: Table1Settings, *, kinds: Sequence[str], spec: HOGSpec
) -> list[MethodOutput]:
    priors = [_needed(kind, settings) for kind in kinds]
    return _levels(image, spec, more=True, prior=priors, **_options(settings))


def _bovw(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    bovw = _needed("bovw", settings)
    result = bovw.reconstruct(bovw.histogram(image), (image.shape[2], image.shape[3]), seed=settings.seed)
    return [MethodOutput(result.image[0, 0], float(result.distance[0]))]


def _needed(kind: str, settings: Table1Settings) -> Any:
    if kind not in settings.learned:
        raise ValueError(f"this method needs what `nablahog learn {TAKES_HOURS.get(kind, kind)}` learns")
    return load(kind, local_path(settings.learned[kind]))


def _cnn_hog(image: Tensor, settings: Table1Settings, *, bilinear: bool) -> list[MethodOutput]:
    network = CNNHOG(bilinear=bilinear)
    result = network.reconstruct(network.descriptor(image), seed=settings.seed)
    return [MethodOutput(result.image[0, 0], float(result.distance[0]))]


def _triangles(image: Tensor, settings: Table1Settings, *, spec: HOGSpec) -> list[MethodOutput]:
    count = settings.max_evaluations or TRIANGLES
    return _inverted(reconstruct_by_triangles, image, spec, seed=settings.seed, triangles=count)


def _variants(
    prefix: str, group: str, spec: HOGSpec, single: Callable[..., Any], multi_scale: Callable[..., Any], *, asked: bool
) -> list[Method]:
    return [
        Method(f"{prefix}-single", group, partial(single, spec=spec), spec, asked=asked),
        *(
            Method(
                f"{prefix}-multi-scale{'-more' if more else ''}",
                group,
                partial(multi_scale, spec=spec, more=more),
                spec,
                multiscale=True,
                asked=asked,
            )
            for more in (False, True)
        ),
    ]


def _learned_prior(name: str, group: str, run: Callable[..., Any], spec: HOGSpec, **options: bool) -> Method:
    kinds = ("prior",) if searchable(spec).signed else ("unsigned-prior", "prior")
    return Method(name, group, partial(run, kinds=kinds, spec=spec), spec, needs=kinds, **options)


_DALAL = presets.paper()
METHODS = {
    method.name: method
    for method in (
        Method("bovw", NO_HOG, _bovw, needs=("bovw",)),
        Method("hoggles", UOCTTI, partial(_learned, kind="hoggles", spec=SPEC), SPEC, needs=("hoggles",)),
        Method("cnn-hog", UOCTTI, partial(_cnn_hog, bilinear=False)),
        Method("cnn-hogb", UOCTTI, partial(_cnn_hog, bilinear=True)),
        Method("ridge", UOCTTI, partial(_learned, kind="ridge", spec=SPEC), SPEC, needs=("ridge",)),
        Method("nearest", UOCTTI, partial(_learned, kind="nearest", spec=SPEC), SPEC, needs=("nearest",)),
        Method("upconv", UOCTTI, partial(_learned, kind="upconv", spec=SPEC), SPEC, needs=("upconv",)),
        Method("triangles", UOCTTI, partial(_triangles, spec=SPEC), SPEC),
        Method("paper-uoctti-single", UOCTTI, partial(_paper_single, spec=SPEC), SPEC, asked=True),
        *_variants("uoctti", UOCTTI, SPEC, _single, _multi_scale, asked=False),
        _learned_prior("uoctti-learned", UOCTTI, _with_prior, SPEC),
        Method(
            "dalal-upconv", DALAL, partial(_learned, kind="dalal-upconv", spec=_DALAL), _DALAL, needs=("dalal-upconv",)
        ),
        *_variants("paper-dalal", DALAL, _DALAL, _paper_single, _paper_multi_scale, asked=True),
        *_variants("dalal", DALAL, _DALAL, _single, _multi_scale, asked=False),
        _learned_prior("dalal-learned", DALAL, _with_prior, _DALAL),
        _learned_prior("dalal-multi-scale-more-learned", DALAL, _multi_scale_more_with_prior, _DALAL, multiscale=True),
        *(Method(name, LIBRARIES, partial(_single, spec=spec), spec, asked=True) for name, spec in DIALECTS.items()),
        *(
            _learned_prior(name, LIBRARIES, _with_prior, DIALECTS[name.removesuffix("-learned")], asked=True)
            for name in LEARNED_DIALECTS
        ),
    )
}
"""All methods by name, each group in the order of the table."""


def choose(
    names: Sequence[str] | None, given: Collection[str], shipped: Collection[str] = ()
) -> tuple[list[Method], list[Method]]:
    """Chooses the methods to run, and lists those left out for want of a file; both in the order of the table.

    Files that can be learned from bundled photographs are optional.

    Args:
        names: of the methods to run; None for all that can run, except those that run only if asked for by name.
        given: names of :data:`.LEARNED` that files were given of.
        shipped: those that the package was installed with files of.

    Raises:
        ValueError: a method in ``names`` lacks a file, or no method uses one of the files given.
    """
    methods = [m for name, m in METHODS.items() if (name in names if names is not None else not m.asked)]
    for kind in given:
        if not any(kind in method.needs for method in methods):
            of = ", ".join(method.name for method in METHODS.values() if kind in method.needs)
            raise ValueError(f"none of the methods asked for uses --learned {kind}; these do: {of}")
    lacking = {
        method.name: kind
        for method in methods
        for kind in reversed(method.needs)
        if kind in TAKES_HOURS and kind not in (*given, *shipped)
    }
    if names is not None and lacking:
        name, kind = next(iter(lacking.items()))
        raise ValueError(f"{name} needs --learned {kind}=FILE, see `nablahog learn {TAKES_HOURS[kind]}`")
    return [method for method in methods if method.name not in lacking], [METHODS[name] for name in lacking]
