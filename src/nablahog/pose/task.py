"""A photograph and candidate models, what a search is given, and what it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import torch
from torch import Tensor

from .choices import Kind
from .matching import Model, Photograph
from .placing import place, upright

Ascent: TypeAlias = Literal["hill", "momentum", "lbfgs"]

ELEVATIONS = (0.0, 15.0, 30.0, 45.0)  # where nothing is known of it, degrees


@dataclass(frozen=True, eq=False)
class Path:
    """A search from one start.

    Attributes:
        model: the model's name.
        azimuths: on the way, degrees.
        similarities: there.
    """

    model: str
    azimuths: tuple[float, ...]
    similarities: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Found:
    """A pose (6,) on the canvas of a model, what has been paid for it, and how it was found."""

    model: str
    pose: Tensor
    value: float
    kind: Kind
    renderings: int
    paths: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class Task:
    photograph: Photograph
    models: Mapping[str, Model]
    initial: tuple[float, float] | None
    similarity: Kind | None
    ascent: Ascent
    generator: torch.Generator
    progress: Callable[[int, int, str], None]

    def each_model(self) -> Iterator[tuple[str, Model]]:
        """The models by name, one after the other."""
        for done, (name, model) in enumerate(self.models.items()):
            self.progress(done, len(self.models), name)
            yield name, model

    def views(self, model: Model, azimuths: Tensor, elevation: float) -> Tensor:
        """Views at azimuths (N,), (N, 6), each placed so that it fills the box."""
        canvas = self.photograph.canvas
        return place(upright(azimuths, elevation), model.hull, canvas.camera, canvas.size)

    @property
    def elevations(self) -> tuple[float, ...]:
        return ELEVATIONS if self.initial is None else (self.initial[1],)
