"""The pose of one object, as a job whose result is stored."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ...io.images import read_exif_focal, read_image
from ...jobs.store import JobResult, digest, key_of
from ...jobs.worker import local_path
from ...paper.lists import ListedObject
from ...pose import estimate_pose
from ...pose.crop import masked
from ...pose.options import Lens, SearchMethod
from ...render import Mesh, load_mesh, sample_chairs
from ...runtime.cache import code_key
from .pose_files import pose_figures
from .pose_page import close_up, pose_page

SIDE = 160  # pixels of the picture of an object
_FILL = 0.8  # of that, the longer side of the box


@dataclass(frozen=True)
class PoseOptions:
    """What the searches for all objects have in common, see :func:`nablahog.estimate_pose`.

    Attributes:
        models: names and files of the models; none for :func:`nablahog.sample_chairs`.
        up, front: axes of these files.
        focal: pixels, "exif" or "unknown"; None: as the photograph's file says, if it does.
        principal_point: x, y, pixels.
        page: whether to make a page for each object.
    """

    models: tuple[tuple[str, Path], ...]
    up: str | None
    front: str | None
    focal: float | str | None
    principal_point: tuple[float, float] | None
    within: float
    method: SearchMethod
    seed: int
    page: bool

    @classmethod
    def of(cls, arguments: Namespace, models: Mapping[str, Path]) -> PoseOptions:
        """By the options of the command of the same names."""
        options = {each.name: getattr(arguments, each.name) for each in fields(cls) if each.name != "models"}
        return cls(tuple((name, path.absolute()) for name, path in models.items()), **options)


@dataclass(frozen=True)
class ObjectJob:
    """The search for the pose of an object.

    Attributes:
        listed: what is known of the object.
        photo: the file of its photograph.
        mask: an image that is white where the object is; None if there is none.
        options: of the search.
    """

    listed: ListedObject
    photo: Path
    mask: Path | None
    options: PoseOptions

    @property
    def name(self) -> str:
        """That of its folder of stored results."""
        return "poses"

    def files(self) -> list[Path]:
        return [self.photo, *filter(None, [self.mask]), *(path for _, path in self.options.models)]

    def key(self) -> str:
        """A hash of what is known of the object, all files, the options, and the code."""
        facts = {
            "box": self.listed.box,
            "initial": self.listed.initial,
            "files": [digest(path) for path in self.files()],
            "options": asdict(replace(self.options, models=())),
            "models": [name for name, _ in self.options.models],
            "code": code_key(ObjectJob),
        }
        return key_of(facts, np.empty(0, np.float32))

    def fits(self, result: JobResult) -> bool:
        """Whether there are figures and a picture."""
        return len(result.figures) == 1 and result.pictures.shape == (1, 3, SIDE, SIDE)

    def run(self, progress: Callable[[int, int, str], None] = lambda done, total, what: None) -> JobResult:
        """Finds the pose: its figures, with the page if there is one, and a picture of the object with the outline."""
        options, photo = self.options, local_path(self.photo)
        photograph, box = read_image(photo), self.listed.box
        if self.mask is not None:
            photograph, box = masked(photograph, read_image(local_path(self.mask)).mean(0) > 0.5, box)
        lens = read_lens(photo, options.focal, options.principal_point)
        meshes = _meshes(options.models, options.up, options.front)
        began = perf_counter()
        estimate = estimate_pose(
            photograph,
            meshes,
            box=box,
            initial=self.listed.initial,
            within=options.within,
            focal=lens.focal,
            principal_point=lens.principal_point,
            method=options.method,
            seed=options.seed,
            progress=progress,
        )
        seconds = perf_counter() - began
        estimate, mesh = replace(estimate, focal_from=lens.source), meshes[estimate.model]
        figures: dict[str, Any] = {**pose_figures(estimate), "seconds": round(seconds, 4)}
        if options.page:
            figures["page"] = pose_page(self.listed.image, photograph, estimate, mesh, list(meshes), options.method)
        _, _, picture = close_up(photograph, estimate, mesh, SIDE, _FILL * SIDE)
        return JobResult([figures], np.rint(255 * picture[None]).astype(np.uint8), seconds)


def read_lens(photo: Path, focal: float | str | None, principal_point: tuple[float, float] | None) -> Lens:
    """What the options and the photograph's file say of its camera."""
    if isinstance(focal, float):
        return Lens(focal, principal_point, "given")
    pixels = None if focal == "unknown" else read_exif_focal(photo)
    if pixels is not None:
        return Lens(pixels, principal_point, "exif")
    if focal == "exif":
        raise ValueError(f"{photo}: its EXIF data has no focal length, or the photograph was cut: expected --focal")
    if principal_point is not None:
        raise ValueError(f"{photo}: --principal-point needs a known focal length: expected --focal")
    return Lens(None, None, "assumed")


@lru_cache(maxsize=2)
def _meshes(models: tuple[tuple[str, Path], ...], up: str | None, front: str | None) -> Mapping[str, Mesh]:
    """Read once by a process for all of its objects."""
    if not models:
        return sample_chairs()
    return {name: load_mesh(local_path(path), up=up, front=front) for name, path in models}
