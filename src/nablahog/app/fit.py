"""Fit: a model that is turned over a photograph's object, with the similarity of their HOGs and its derivative."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import torch
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.descriptor import describe
from ..inputs.boxes import Box
from ..io.arrays import naming
from ..io.camera_file import read_camera_file
from ..io.input_file import InputFile
from ..pose import PoseEstimate, estimate_pose
from ..pose.crop import CROP_SIDE, ObjectCrop, check_box, crop_object
from ..pose.lens import Lens, check_camera_size, choose_lens
from ..pose.model import PreparedModel, azimuth_sweep, fit_to_box, prepared_model
from ..pose.photograph import PreparedPhotograph
from ..pose.result import pose_figures, warning
from ..pose.similarity import Similarity
from ..render import silhouette
from ..requests.pose import FROM_FILE, UNKNOWN, PoseRequest
from ..viz.pictures import outlined
from .chart import AZIMUTHS, SimilarityChart
from .messages import Open, Pose, PoseMessage, RequestError, Turn, as_request_error, glyphs, png
from .snippets import FitFiles, write_pose_snippets
from .store import MeshEntry, Photograph, Store
from .work_queue import CancelToken

SPEC: HOGSpec = presets.uoctti(8)  # of the glyphs on the page
CROP_GLYPHS_SIDE = 400  # pixels, about, of their longer side
PAGE_SUPERSAMPLING = 2  # of renderings and similarities on the page
POINTS_AT_ONCE = 36  # points in a message
LEAST_SIDE = 8  # pixels of a photograph, as of a box
LEAST_DISTANCE, MOST_DISTANCE = 1.0, 100.0  # in diagonals of the model


@dataclass(frozen=True, eq=False)
class Fitting:
    """A photograph's object, with its camera, its box, its crop, and a model.

    ``image`` is the photograph as the ideal camera would have taken it; the request's box belongs to the photograph as
    it is, the crop to that image.  The chart shows the last pose that was viewed and the last curve.
    """

    photograph: Photograph
    model: MeshEntry
    request: Open | PoseMessage
    lens: Lens
    image: Tensor
    box: Box
    crop: ObjectCrop
    chart: SimilarityChart = field(default_factory=SimilarityChart)

    @classmethod
    def open(cls, request: Open | PoseMessage, store: Store) -> Fitting:
        """The photograph's object and the model that a request names."""
        photograph, model = store.get(request.photo, Photograph), store.get(request.mesh, MeshEntry)
        height, width = photograph.size
        if min(height, width) < LEAST_SIDE:
            raise RequestError(
                422,
                f"{photograph.name}: expected a photograph of at least {LEAST_SIDE}x{LEAST_SIDE} pixels, "
                f"got {height}x{width} (height x width); choose a larger one",
            )
        with as_request_error():
            box = check_box(request.box or (0, 0, width, height), height, width)
            lens = _choose_lens(photograph, request)
            image = lens.undistort(photograph.image)
            crop = crop_object(image, lens.map_box(box), focal=lens.focal, axis=lens.principal_point)
        return cls(photograph, model, request, lens, image, box, crop)

    @cached_property
    def prepared(self) -> PreparedModel:
        """The model with its renderers."""
        return prepared_model(self.model.mesh)

    @cached_property
    def similarity(self) -> Similarity:
        """The calibrated similarity of a rendering to the object."""
        template = PreparedPhotograph(self.crop).template("calibrated")
        return self.prepared.similarity(template, supersampling=PAGE_SUPERSAMPLING, camera=self.crop.camera)

    def ready(self) -> dict[str, Any]:
        """The message that the page needs before a pose is shown."""
        _ = self.similarity  # prepared here, where a moment's wait is expected
        crop = self.crop
        return {
            "type": "ready",
            "crop": {"side": CROP_SIDE, "zoom": crop.zoom, "middle": list(crop.middle)},
            "photo_glyphs": glyphs(describe(crop.image, SPEC)[0], SPEC, CROP_GLYPHS_SIDE),
            "image": png(crop.image[0]),
        }

    def view(self, turn: Turn) -> dict[str, Any]:
        """The rendering at a pose, its glyphs, its similarity and the derivative of that."""
        began = time.perf_counter()
        with as_request_error():
            poses = self._poses(turn.pose, turn.place)
            values, derivatives = self.similarity.derivatives(poses)
            renderer = self.prepared.renderer(supersampling=PAGE_SUPERSAMPLING, camera=self.crop.camera)
            white, black = (renderer.render(poses, level, derivative=False).image[0] for level in (1.0, 0.0))
        opacity = (1 - (white - black)).clamp(0, 1)
        own = torch.where(opacity > 0, black / torch.where(opacity > 0, opacity, 1), 0)
        self.chart.move(tuple(poses[0].tolist()), float(values[0]), float(derivatives[0, 0]), turn.width)
        return {
            "type": "view",
            "n": turn.n,
            "pose": _round(poses[0]),
            "similarity": float(values[0]),
            "derivative": _round(derivatives[0]),
            "image": png(own, opacity),
            "glyphs": glyphs(describe(white[None, None], SPEC)[0], SPEC, CROP_GLYPHS_SIDE),
            "chart": self.chart.draw(),
            "milliseconds": round(1000 * (time.perf_counter() - began), 2),
        }

    def _poses(self, pose: Pose, place: bool) -> Tensor:
        """(1, 6), within what can be rendered."""
        azimuth, elevation, distance, theta, x, y = pose
        poses = torch.tensor(
            [[azimuth % 360, min(max(elevation, -90), 90), distance, theta, x, y]], dtype=torch.float64
        )
        poses[:, 2] = poses[:, 2].clamp(LEAST_DISTANCE, MOST_DISTANCE)
        return fit_to_box(poses, self.prepared.hull, self.crop.camera, self.crop.size) if place else poses

    def curve(self, pose: Pose) -> Iterator[Callable[[], dict[str, Any]]]:
        """The work for each part of the curve of a pose at all azimuths; the last one's answer says that it is done."""
        start = self._poses(pose, False)[0].clone()
        start[0] = 0
        self.chart.begin_curve(tuple(start.tolist()))
        poses = azimuth_sweep(start, AZIMUTHS)
        for first in range(0, AZIMUTHS, POINTS_AT_ONCE):
            yield partial(self._part_of_curve, poses[first : first + POINTS_AT_ONCE], first)

    def _part_of_curve(self, poses: Tensor, first: int) -> dict[str, Any]:
        with as_request_error():
            values, derivatives = self.similarity.derivatives(poses)
        self.chart.add_to_curve(first, values, derivatives[:, 0])
        return {"type": "curve", "done": first + len(poses) == AZIMUTHS, "chart": self.chart.draw()}

    def fit(
        self,
        request: PoseRequest,
        send: Callable[[dict[str, Any]], None] | None,
        cancel: CancelToken,
    ) -> PoseEstimate:
        """The pose that the search finds; poses on the way are sent as they come, if somebody gets them."""

        self.chart.steps.clear()

        def watch(model: str, pose: Tensor) -> None:
            cancel.check()
            if send is None:
                return  # nor is their similarity computed
            value = float(self.similarity.values(pose[None]))
            self.chart.steps.append((float(pose[0]), value))
            send({"type": "step", "pose": _round(pose), "similarity": value})

        def progress(done: int, total: int, what: str) -> None:
            cancel.check()
            if send is not None:
                send({"type": "progress", "done": done, "total": total, "what": what})

        with as_request_error():
            asked = replace(
                request,
                box=(*self.lens.map_box(self.box),),
                focal=self.lens.focal,
                principal_point=self.lens.principal_point,
                intrinsics=None,
                distortion=None,
            )
            return estimate_pose(
                self.image,
                {self.model.name: self.model.mesh},
                **asked.keywords(),
                progress=progress,
                watch=watch,
            )

    def figures(self, estimate: PoseEstimate, request: PoseRequest) -> dict[str, Any]:
        """The figures of a pose, with what was asked for."""
        settings = {"mesh": self.model.name, "method": request.method, "seed": request.seed}
        reported = self.lens.report(estimate, self.box)
        return {"photograph": self.photograph.name, **pose_figures(reported), "settings": settings}

    def fitted(self, estimate: PoseEstimate, request: PoseRequest) -> dict[str, Any]:
        """The message that ends a search."""
        photo, model, opened = self.photograph, self.model, self.request
        focal = photo.focal if opened.focal == FROM_FILE else None if opened.focal == UNKNOWN else opened.focal
        camera = {name: getattr(opened, name) for name in ("principal_point", "intrinsics", "distortion")}
        asked = replace(request, box=(*self.box,), focal=focal, **camera)
        chair = model.name if model.packaged else None
        files = FitFiles(photo.name, photo.focal is not None, model.name, model.up, model.front, chair)
        return {
            "type": "fitted",
            "pose": _round(estimate.crop_pose),
            "similarity": float(self.similarity.values(estimate.crop_pose[None])),
            "result": self.figures(estimate, request),
            "overlay": png(self._overlay(estimate)),
            "second_overlay": None if estimate.second is None else png(self._overlay(estimate.second)),
            "warning": warning(self.lens.report(estimate, self.box)),
            "snippets": write_pose_snippets(asked, files),
        }

    def _overlay(self, estimate: PoseEstimate) -> Any:
        """The image with the model's outline."""
        inside = silhouette(*estimate.render_arguments(self.model.mesh))[0, 0] > 0.5
        return outlined(self.image, inside.numpy())


def _choose_lens(photograph: Photograph, request: Open | PoseMessage) -> Lens:
    """What a request says about the camera, or the photograph's file."""
    focal, size = None if request.focal == UNKNOWN else request.focal, photograph.size
    with naming(photograph.name):
        return choose_lens(
            size, focal, request.principal_point, request.intrinsics, request.distortion, photograph.focal
        )


def read_camera(data: bytes, name: str, query: Mapping[str, str], store: Store) -> dict[str, Any]:
    """The numbers of a camera's file, if they are for the photograph whose id is in ``query``."""
    with as_request_error():
        camera = read_camera_file(InputFile(name, data))
        with naming(name):
            check_camera_size(camera, *store.get(query.get("photo", ""), Photograph).size)
    return {"intrinsics": camera.intrinsics, "distortion": camera.distortion}


def _round(values: Tensor) -> list[float]:
    return [round(value, 6) for value in values.tolist()]
