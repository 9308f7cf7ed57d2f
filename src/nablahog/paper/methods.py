"""The methods of Table 1.  A new one is an entry of :data:`METHODS`, and its name in :mod:`.names`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

from torch import Tensor

from ..hog import HOGSpec, hog, presets
from ..invert import AsPublished, Reconstruction, Search, reconstruct, reconstruct_multiscale, scale_descriptors
from ..invert.histograms import linear_vote_spec
from ..invert.scales import SCALES, level_spec
from ..invert.starts import enlarge
from ..jobs.worker import local_path
from .baselines.cnn_hog import CNNHOG
from .learned import SPEC, load
from .names import DALAL, DIALECTS, LIBRARIES, NO_HOG, PRIORS, UOCTTI


@dataclass(frozen=True)
class Table1Settings:
    """The settings of all methods of a run: a seed, and files that they learned, by the names of :data:`.LEARNED`.

    Evaluations are of the objective, for each image; None for the method's own default.
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
class ReconstructionMethod:
    """A method of the table.

    Attributes:
        name: unique.
        group: its kind of input, one of :data:`.names.GROUPS`.
        run: from an image (1, 1, H, W), float32 in 0…1, to one output for each of ``rows``, in order.  It depends on
            nothing but its arguments, and raises ValueError with one sentence for an image it cannot take.  Worker
            processes import it, so it is a function of a module, or a ``functools.partial`` of one.
        spec: the dialect of its input descriptor; None if that is no HOG.
        multiscale: whether it also has a row for each of :data:`SCALES`.
        needs: the kinds of learned files that it reads; the first is for descriptors of ``spec``.
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


Scales: TypeAlias = Literal["one descriptor", "one each"]
"""The input of a multi-scale method: the descriptor of the image, or one for each level (multi-scale-more)."""


def _run_search(
    image: Tensor,
    settings: Table1Settings,
    *,
    spec: HOGSpec,
    scales: Scales | None = None,
    published: bool = False,
    priors: Sequence[str] = (),
) -> list[MethodOutput]:
    """Inverts the descriptor of an image by a search, the paper's own or ours, perhaps with learned priors."""
    options: dict[str, Any] = {"seed": settings.seed}
    if published:
        options["method"] = AsPublished(max_evaluations=settings.max_evaluations)
    else:
        options["search"] = Search(max_evaluations=settings.max_evaluations)
        options["prior"] = [_load_needed(kind, settings) for kind in priors] or None
    size = (image.shape[2], image.shape[3])
    if scales is None:
        return [_output(reconstruct(hog(image, spec), spec, size, **options))]
    for scale in SCALES:
        level_spec(spec, scale, size)  # raises before the work, not after
    descriptors = scale_descriptors(image, spec, SCALES) if scales == "one each" else hog(image, spec)
    levels = []
    for level in reconstruct_multiscale(descriptors, spec, size, scales=SCALES, **options):
        enlarged = enlarge(level.reconstruction.image, *size)[0, 0].clamp(0, 1)
        levels.append(MethodOutput(enlarged, float(level.reconstruction.distance[0])))
    return [levels[-1], *levels]


def _output(result: Reconstruction) -> MethodOutput:
    return MethodOutput(result.image[0, 0], float(result.distance[0]))


def _load_needed(kind: str, settings: Table1Settings) -> Any:
    if kind not in settings.learned:
        raise ValueError(f"this method needs a file made by `nablahog learn {PRIORS.get(kind, kind)}`")
    return load(kind, local_path(settings.learned[kind]))


def _bovw(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    bovw = _load_needed("bovw", settings)
    return [_output(bovw.reconstruct(bovw.histogram(image), seed=settings.seed))]


def _hoggles(image: Tensor, settings: Table1Settings) -> list[MethodOutput]:
    size = (image.shape[2], image.shape[3])
    return [_output(_load_needed("hoggles", settings).reconstruct(hog(image, SPEC), SPEC, size))]


def _cnn_hog(image: Tensor, settings: Table1Settings, *, bilinear: bool) -> list[MethodOutput]:
    network = CNNHOG(bilinear=bilinear)
    return [_output(network.reconstruct(network.descriptor(image), seed=settings.seed))]


def _search(
    name: str,
    group: str,
    spec: HOGSpec,
    scales: Scales | None = None,
    *,
    asked: bool = False,
    published: bool = False,
    learned: bool = False,
) -> ReconstructionMethod:
    """The method that runs :func:`_run_search` with these options."""
    priors: tuple[str, ...] = ()
    if learned:
        priors = ("prior",) if linear_vote_spec(spec).signed else ("unsigned-prior", "prior")
    run = partial(_run_search, spec=spec, scales=scales, published=published, priors=priors)
    return ReconstructionMethod(name, group, run, spec, scales is not None, priors, asked)


def _scale_methods(prefix: str, group: str, spec: HOGSpec, *, published: bool = False) -> list[ReconstructionMethod]:
    """Single-scale, multi-scale and multi-scale-more."""
    search = partial(_search, group=group, spec=spec, published=published, asked=published)
    return [
        search(f"{prefix}-single"),
        search(f"{prefix}-multi-scale", scales="one descriptor"),
        search(f"{prefix}-multi-scale-more", scales="one each"),
    ]


_DALAL = presets.paper()
METHODS = {
    method.name: method
    for method in (
        ReconstructionMethod("bovw", NO_HOG, _bovw, needs=("bovw",)),
        ReconstructionMethod("hoggles", UOCTTI, _hoggles, SPEC, needs=("hoggles",)),
        ReconstructionMethod("cnn-hog", UOCTTI, partial(_cnn_hog, bilinear=False)),
        ReconstructionMethod("cnn-hogb", UOCTTI, partial(_cnn_hog, bilinear=True)),
        _search("paper-uoctti-single", UOCTTI, SPEC, published=True, asked=True),
        *_scale_methods("uoctti", UOCTTI, SPEC),
        _search("uoctti-learned", UOCTTI, SPEC, learned=True),
        *_scale_methods("paper-dalal", DALAL, _DALAL, published=True),
        *_scale_methods("dalal", DALAL, _DALAL),
        _search("dalal-learned", DALAL, _DALAL, learned=True),
        _search("dalal-multi-scale-more-learned", DALAL, _DALAL, "one each", learned=True),
        *(_search(name, LIBRARIES, spec, asked=True) for name, spec in DIALECTS.items()),
        *(_search(f"{name}-learned", LIBRARIES, spec, asked=True, learned=True) for name, spec in DIALECTS.items()),
    )
}
"""All methods by name, each group in the order of the table."""


def choose(
    names: Sequence[str] | None, files: Collection[str], shipped: Collection[str] = ()
) -> tuple[list[ReconstructionMethod], list[ReconstructionMethod]]:
    """Chooses the methods to run, and lists those left out for want of a file; both in the order of the table.

    Args:
        names: of the methods to run; None for all that can run, except those that run only if asked for by name.
        files: names of :data:`.LEARNED` for which the user has a file.
        shipped: names of :data:`.LEARNED` for which the package was installed with a file.

    Raises:
        ValueError: a method in ``names`` lacks a file, or no method uses one of the files.
    """
    methods = [m for name, m in METHODS.items() if (name in names if names is not None else not m.asked)]
    for kind in files:
        if not any(kind in method.needs for method in methods):
            usable = ", ".join(method.name for method in METHODS.values() if kind in method.needs)
            raise ValueError(f"none of the methods asked for uses a file of {kind}; these do: {usable}")
    lacking = {
        method.name: kind
        for method in methods
        for kind in reversed(method.needs)
        if kind in PRIORS and kind not in (*files, *shipped)
    }
    if names is not None and lacking:
        name, kind = next(iter(lacking.items()))
        raise ValueError(f"{name} needs a file of {kind}, see `nablahog learn {PRIORS[kind]}`")
    return [method for method in methods if method.name not in lacking], [METHODS[name] for name in lacking]
