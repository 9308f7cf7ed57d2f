"""Aubry et al.'s exemplars ("Seeing 3D chairs"): renderings of a model from all around, and the elements of each.

Constants and steps are those of their released code (``DEinit_n100_ms4.m``), which differ a little from the paper's.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..archive import check_format, read_arrays, text
from ..hog.kernels import steps
from ..hog.presets import aubry
from ..hog.spec import HOGSpec
from ..output import replacing
from ..render import Camera, Light, Mesh, Renderer, silhouette
from .elements import EMPTY, all_patches, apart, calibration
from .whitening import Background

FORMAT = 1
SPEC = aubry(5)
LEVELS = 3  # of a pyramid, an octave
SIDE = 200  # pixels of a rendering: a model of diagonal 1, and half an element around it
FOCAL = 150 / math.tan(math.radians(54.611 / 2))  # pixels; they render 600 pixels at 54.611° and begin at half of it
LIGHT = Light(ambient=0.2, diffuse=0.8)
_COLUMNS = ("weights", "scale", "offset", "level", "positions", "first", "boxes", "viewpoints")


@dataclass(frozen=True)
class Viewing:
    """From where models are rendered, and what is kept of each rendering.

    Attributes:
        azimuths: degrees; theirs are the integers of linspace(0, 360, 32), 31 directions.
        elevations: degrees.
        distance: to the camera, in diagonals of the model.
        size: rows and columns of an element in cells of 5 pixels; theirs comes with a file that is not published with
            the code.
        count: elements of a rendering.
        overlap, threshold: as for :func:`.elements.elements`.
    """

    azimuths: tuple[int, ...] = tuple(int(angle) for angle in np.linspace(0, 360, 32)[:-1])
    elevations: tuple[int, ...] = (20, 30)
    distance: float = 2.0
    size: tuple[int, int] = (10, 10)
    count: int = 10
    overlap: float = 0.25
    threshold: float = 2.0

    def poses(self) -> Tensor:
        """(V, 6), see :data:`nablahog.render.PARAMETERS`."""
        rows = [(azimuth, elevation, self.distance, 0, 0, 0) for elevation in self.elevations for azimuth in self.azimuths]
        return torch.tensor(rows, dtype=torch.float64)


VIEWING = Viewing()


@dataclass(frozen=True, eq=False)
class Views:
    """The elements of all views of a model.

    Attributes:
        weights: (E, r, c, C), float32, as in :class:`.elements.Elements`.
        scale, offset: (E,), float32, likewise.
        level: (E,), int64: of the pyramid in which an element was found, 0 the rendering itself.
        positions: (E, 2), int64: row and column of its upper left cell there.
        first: (V + 1,), int64: the elements of view v are first[v] … first[v + 1] − 1.
        boxes: (V, 4), float32: top, left, bottom and right of what is seen, in pixels of the rendering.
        viewpoints: (V, 2), float32: azimuth and elevation, degrees.

    Raises:
        ValueError: these contradict each other, or hold NaN or Inf.
    """

    weights: Tensor
    scale: Tensor
    offset: Tensor
    level: Tensor
    positions: Tensor
    first: Tensor
    boxes: Tensor
    viewpoints: Tensor

    def __post_init__(self) -> None:
        elements, views = len(self.scale), len(self.viewpoints)
        cells = tuple(self.weights.shape[1:])
        of_views = {"boxes": (views, 4), "viewpoints": (views, 2)}
        floats = {"weights": (elements, *cells), "scale": (elements,), "offset": (elements,)} | of_views
        integers = {"level": (elements,), "positions": (elements, 2), "first": (views + 1,)}
        for shapes, dtype in ((floats, torch.float32), (integers, torch.int64)):
            for name, shape in shapes.items():
                array: Tensor = getattr(self, name)
                if array.dtype != dtype or array.shape != shape or not bool(torch.isfinite(array).all()):
                    raise ValueError(f"{name} must be {dtype} of shape {shape} and finite, got {array.dtype} of {tuple(array.shape)}")
        bounded = bool(((self.level >= 0) & (self.level < 64)).all()) and bool((self.positions >= 0).all())
        in_order = bool((self.first.diff() >= 0).all()) and int(self.first[0]) == 0 and int(self.first[-1]) == elements
        if len(cells) != 3 or not bounded or not in_order:
            raise ValueError("the elements of views must be four-dimensional, in pyramids, and in order of the views")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to the file ``path``, an .npz archive of its attributes and ``format`` (1); weights in float16.

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {name: getattr(self, name).numpy() for name in _COLUMNS}
        arrays["weights"] = arrays["weights"].astype(np.float16)
        with replacing(path) as file:
            np.savez(file, format=np.array(FORMAT), **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Views:
        """What :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, or its arrays contradict each other.
        """
        arrays = read_arrays(path, "file of exemplars", ("format", *_COLUMNS))
        try:
            check_format(arrays, "exemplar", FORMAT)
            if arrays["weights"].dtype == np.float16:
                arrays["weights"] = arrays["weights"].astype(np.float32)
            return cls(**{name: torch.from_numpy(arrays[name]) for name in _COLUMNS})
        except (TypeError, ValueError, IndexError, RuntimeError) as error:
            raise ValueError(f"{os.fspath(path)}: {error}") from None
