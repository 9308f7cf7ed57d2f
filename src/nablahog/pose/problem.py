"""What a search is asked and what it returns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ..hog.box import Box
from .confidence import Evidence
from .crop import FILL
from .options import Ascent, SimilarityKind
from .placement import fit_to_box, level_poses
from .prepared import PreparedModel, PreparedPhotograph
from .viewpoint_network import ViewpointPrior

ELEVATIONS = (-15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
LEVEL = (-15.0, 0.0, 15.0)  # tilts, where a pose is given
TILTS = (-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0)  # tried where nothing is known of it, degrees
USUAL = (-10.0, 40.0)  # degrees of elevation that most photographs are taken from
STEEP, TURNED = 0.03, 0.01  # of calibrated similarity, that a pose loses for a degree beyond, and of in-plane rotation
SMALL = 0.5  # likewise, for each halving of an object's size in a photograph where it may be anywhere


@dataclass(frozen=True, eq=False)
class SearchTrace:
    """The poses that a search from one start went through.

    Attributes:
        model: the model's name.
        azimuths: degrees, in order, of any turn.
        similarities: at these poses.
    """

    model: str
    azimuths: tuple[float, ...]
    similarities: tuple[float, ...]


class RunnerUp(NamedTuple):
    """The best pose from another side than the best one.

    Attributes:
        model: the model's name.
        pose: (6,), angles in degrees.
        share: of the best pose's similarity that it has; of the coarse one, if the search has not come closer.  Among
            several models, of the votes for the best one's side.
    """

    model: str
    pose: Tensor
    share: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best pose and model of a search.

    Attributes:
        model: the model's name.
        pose: (6,) for the crop, angles in degrees, see :data:`nablahog.render.PARAMETERS`.
        similarity: there.
        kind: of the similarity.
        renderings: compared with the photograph.
        traces: of all starts, if the search keeps them.
        runners_up: the best poses from other sides, for the crop, the best first, if the search keeps them.
        same_view: other azimuths from which the model looks the same, degrees.
        evidence: of how sure the pose is; None for similarities that cannot be compared between photographs.
    """

    model: str
    pose: Tensor
    similarity: float
    kind: SimilarityKind
    renderings: int
    traces: tuple[SearchTrace, ...] = ()
    runners_up: tuple[RunnerUp, ...] = ()
    same_view: tuple[float, ...] = ()
    evidence: Evidence | None = None


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """A photograph, candidate models, and how to search.

    Attributes:
        image: (C, H, W), the whole photograph.
        photograph: the object's crop with its templates.
        models: the candidates by name.
        boxes: x0, y0, x1, y1 of others that the object may be in, pixels of the photograph; None if one was given.
        initial: azimuth and elevation to begin at, degrees; None if unknown.
        within: degrees of azimuth on both sides of the initial one that are searched.
        similarity: its kind; None for that of the search.
        ascent: of the coarse-to-fine search.
        viewpoints: what says from which side an object is seen, among several models; None for views alone.
        generator: of what is sampled.
        progress: called with the models done, their number and the name of the one at work.
        watch: called with the name of a model and each pose (6,) of it for the crop that the search comes to.
    """

    image: Tensor
    photograph: PreparedPhotograph
    models: Mapping[str, PreparedModel]
    boxes: tuple[Box, ...] | None
    initial: tuple[float, float] | None
    within: float
    similarity: SimilarityKind | None
    ascent: Ascent
    viewpoints: ViewpointPrior | None
    generator: torch.Generator
    progress: Callable[[int, int, str], None]
    watch: Callable[[str, Tensor], None] = lambda model, pose: None

    def each_model(self) -> Iterator[tuple[str, PreparedModel]]:
        """The models by name, one after the other, with progress."""
        for done, (name, model) in enumerate(self.models.items()):
            self.progress(done, len(self.models), name)
            yield name, model

    def allowed(self, azimuths: Tensor) -> Tensor:
        """Which azimuths (N,) are searched, (N,), bool."""
        return allowed_azimuths(azimuths, self.initial, self.within)

    def unlikely(self, poses: Tensor, photograph: PreparedPhotograph) -> Tensor:
        """What poses (N, 6) for a crop lose of their similarity in comparisons, (N,), where no pose or box is given.

        Few photographs are taken from high above, or with a tilted camera, or of something small.
        """
        lost = torch.zeros(len(poses), dtype=poses.dtype)
        if self.similarity not in (None, "calibrated"):
            return lost
        if self.initial is None:
            lost += unlikely_view(poses[:, 1], poses[:, 3])
        if self.boxes is not None:
            lost += SMALL * max(0.0, math.log2(max(self.image.shape[1:]) * photograph.crop.zoom / FILL))
        return lost

    @property
    def tilts(self) -> tuple[float, ...]:
        """In-plane rotations to search at, degrees."""
        return TILTS if self.initial is None else LEVEL

    @property
    def elevations(self) -> tuple[float, ...]:
        """Elevations to search at, degrees."""
        return ELEVATIONS if self.initial is None else (self.initial[1],)

    def level_views(self, model: PreparedModel, azimuths: Tensor, elevation: float) -> Tensor:
        """Poses (N, 6) at azimuths (N,) and an elevation, degrees, each placed so that it fills the box."""
        return self.fit(model, level_poses(azimuths, elevation))

    def fit(self, model: PreparedModel, poses: Tensor, photograph: PreparedPhotograph | None = None) -> Tensor:
        """Poses (N, 6) moved so that the model fills the object's box, or that of another crop."""
        crop = (photograph or self.photograph).crop
        return fit_to_box(poses, model.hull, crop.camera, crop.size)

    def cropped(self, box: Sequence[float]) -> PreparedPhotograph:
        """The crop of the photograph around another box, seen through the same lens."""
        return self.photograph.around(self.image, box)


def unlikely_view(elevations: Tensor, tilts: Tensor) -> Tensor:
    """What views of elevations (N,) and in-plane rotations (N,), degrees, lose of their similarity, (N,)."""
    low, high = USUAL
    return STEEP * ((elevations - high).clamp(min=0) + (low - elevations).clamp(min=0)) + TURNED * tilts.abs()


def allowed_azimuths(azimuths: Tensor, initial: tuple[float, float] | None, within: float) -> Tensor:
    """Which azimuths (N,) are within degrees of the initial one, (N,), bool; the nearest always is."""
    if initial is None:
        return torch.ones(len(azimuths), dtype=torch.bool)
    distances = ((azimuths - initial[0] + 180) % 360 - 180).abs()
    return distances <= max(within, float(distances.min()))
