"""The pose of one object of many, as a job whose result is stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ...io.images import as_array, read_image
from ...jobs.job_files import local_path
from ...jobs.store import JobResult, digest, key_of
from ...paper.object_lists import ListedObject
from ...pose import Background, PoseEstimate, estimate_pose
from ...pose.crop import FILL, crop_object
from ...pose.options import SearchMethod, SimilarityKind
from ...render import PARAMETERS, Mesh, load_mesh, sample_chairs, silhouette
from ...runtime.source import code_key
from ...viz.pictures import outlined
from ..inputs.lens import LensOptions
from ..inputs.viewpoint_prior import NO_PRIOR, viewpoint_choice
from .pose_result import camera_figures

SIDE = 160  # pixels of the picture of an object
_FILL = 0.8  # of that, the longer side of the box


@dataclass(frozen=True)
class PoseOptions:
    """What the searches for all objects have in common, see :func:`nablahog.estimate_pose`.

    Attributes:
        models: names and files of the models; none for :func:`nablahog.sample_chairs`.
        up, front: axes of these files.
        lens: of the cameras.
        background: a file.
        viewpoint_prior: a file, or "none".
    """

    models: tuple[tuple[str, Path], ...]
    up: str | None
    front: str | None
    lens: LensOptions
    within: float
    method: SearchMethod
    similarity: SimilarityKind | None
    background: Path | None
    viewpoint_prior: Path | None
    seed: int

    @property
    def files(self) -> list[Path]:
        prior = None if self.viewpoint_prior == NO_PRIOR else self.viewpoint_prior
        return [path for _, path in self.models] + [path for path in (self.background, prior) if path is not None]


@dataclass(frozen=True)
class PoseJob:
    """The search for the pose of an object.

    Attributes:
        annotation: what is known of the object.
        photo: the file of its photograph.
        options: of the search.
    """

    annotation: ListedObject
    photo: Path
    options: PoseOptions

    @property
    def name(self) -> str:
        """That of its folder of stored results."""
        return "poses"

    def files(self) -> list[Path]:
        return [self.photo, *self.options.files]

    def key(self) -> str:
        """A hash of what is known of the object, all files, the options, and the code."""
        facts = {
            "box": self.annotation.box,
            "initial": self.annotation.initial,
            "files": [digest(path) for path in self.files()],
            "options": asdict(replace(self.options, models=(), background=None, viewpoint_prior=None)),
            "models": [name for name, _ in self.options.models],
            "without_prior": self.options.viewpoint_prior == NO_PRIOR,
            "code": code_key(PoseJob),
        }
        return key_of(facts, np.empty(0, np.float32))

    def fits(self, result: JobResult) -> bool:
        """Whether there are figures and a picture."""
        return len(result.figures) == 1 and result.pictures.shape == (1, 3, SIDE, SIDE)

    def run(self) -> JobResult:
        """Finds the pose; its figures, and a picture of the object with the model's outline, uint8.

        Raises:
            ValueError, OSError: an input is unusable.
        """
        options, annotation = self.options, self.annotation
        photograph = read_image(local_path(self.photo))
        prior = options.viewpoint_prior
        lens = options.lens.lens(str(local_path(self.photo)), *photograph.shape[1:])
        meshes = _meshes(options)
        began = perf_counter()
        estimate = estimate_pose(
            photograph,
            meshes,
            box=annotation.box,
            initial=annotation.initial,
            within=options.within,
            focal=lens.focal,
            principal_point=lens.principal_point,
            method=options.method,
            similarity=options.similarity,
            background=None if options.background is None else Background.load(local_path(options.background)),
            viewpoints=viewpoint_choice(prior if prior is None or prior == NO_PRIOR else local_path(prior)),
            seed=options.seed,
        )
        seconds = perf_counter() - began
        estimate = replace(estimate, focal_from=lens.source)
        known = estimate.camera.focal, estimate.principal_point
        close = crop_object(photograph, estimate.box, SIDE, _FILL * SIDE, *known)
        pose = estimate.crop_pose.clone()
        pose[4:] *= _FILL * SIDE / FILL
        inside = as_array(silhouette(meshes[estimate.model], pose[None], close.camera)[0, 0]) >= 0.5
        picture = np.rint(255 * outlined(close.image[0], inside)).astype(np.uint8)
        return JobResult([pose_figures(estimate)], picture[None], seconds)


def pose_figures(estimate: PoseEstimate) -> dict[str, Any]:
    """The figures of an object of :mod:`.pose_list`, ready for JSON."""
    return {
        "image_size": [estimate.camera.height, estimate.camera.width],
        "box": list(estimate.box),
        "model": estimate.model,
        **dict(zip(PARAMETERS, estimate.pose[0].tolist(), strict=True)),
        **camera_figures(estimate),
        "any_azimuth": estimate.any_azimuth,
        "equivalent_azimuths": list(estimate.equivalent_azimuths),
        "similarity": estimate.similarity,
        "confidence": estimate.confidence,
        "runners_up": [
            {"model": one.model, **dict(zip(PARAMETERS, one.pose.tolist(), strict=True)), "share": one.share}
            for one in estimate.runners_up
        ],
    }


def _meshes(options: PoseOptions) -> Mapping[str, Mesh]:
    return _read(options.models, options.up, options.front)


@lru_cache(maxsize=2)
def _read(models: tuple[tuple[str, Path], ...], up: str | None, front: str | None) -> dict[str, Mesh]:
    """Read once by a process for all of its objects."""
    if not models:
        return sample_chairs()
    return {name: load_mesh(local_path(path), up=up, front=front) for name, path in models}
