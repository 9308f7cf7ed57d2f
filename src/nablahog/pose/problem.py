"""What a search is asked and what it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from .options import Ascent, SimilarityKind
from .placement import fit_to_box, level_poses
from .prepared import PreparedModel, PreparedPhotograph

ELEVATIONS = (0.0, 15.0, 30.0, 45.0)  # tried where nothing is known of it, degrees


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
    """

    model: str
    pose: Tensor
    similarity: float
    kind: SimilarityKind
    renderings: int
    traces: tuple[SearchTrace, ...] = ()


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """A photograph, candidate models, and how to search.

    Attributes:
        photograph: the object's crop with its templates.
        models: the candidates by name.
        initial: azimuth and elevation to begin at, degrees; None if unknown.
        similarity: its kind; None for that of the search.
        ascent: of the coarse-to-fine search.
        generator: of what is sampled.
        progress: called with the models done, their number and the name of the one at work.
        watch: called with the name of a model and each pose (6,) of it for the crop that the search comes to.
    """

    photograph: PreparedPhotograph
    models: Mapping[str, PreparedModel]
    initial: tuple[float, float] | None
    similarity: SimilarityKind | None
    ascent: Ascent
    generator: torch.Generator
    progress: Callable[[int, int, str], None]
    watch: Callable[[str, Tensor], None] = lambda model, pose: None

    def each_model(self) -> Iterator[tuple[str, PreparedModel]]:
        """The models by name, one after the other, with progress."""
        for done, (name, model) in enumerate(self.models.items()):
            self.progress(done, len(self.models), name)
            yield name, model

    @property
    def elevations(self) -> tuple[float, ...]:
        """Elevations to search at, degrees."""
        return ELEVATIONS if self.initial is None else (self.initial[1],)

    def level_views(self, model: PreparedModel, azimuths: Tensor, elevation: float) -> Tensor:
        """Poses (N, 6) at azimuths (N,) and an elevation, degrees, each placed so that it fills the box."""
        return self.fit(model, level_poses(azimuths, elevation))

    def fit(self, model: PreparedModel, poses: Tensor) -> Tensor:
        """Poses (N, 6) moved so that the model fills the object's box."""
        crop = self.photograph.crop
        return fit_to_box(poses, model.hull, crop.camera, crop.size)
