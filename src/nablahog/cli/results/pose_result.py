"""A pose estimate and its figures."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ...hog.box import Box
from ...io.images import as_array
from ...pose import PoseEstimate
from ...pose.crop import SIDE
from ...pose.options import SearchMethod
from ...pose.placement import azimuth_sweep
from ...pose.prepared import ELEMENT, PreparedPhotograph, prepared_model
from ...pose.problem import SearchTrace
from ...pose.similarity import Similarity
from ...render import PARAMETERS, Mesh
from ...render.renderer import Method

AZIMUTHS = 180  # at which similarity is computed
SAMPLES = 4  # of a pixel along a side there: with fewer, even the derivative of covered areas is off
STEP = 0.1  # degrees to either side, of central differences: similarity is jagged below a degree

DEFINITIONS = {
    "model": "The model that fits best, of all candidates. Without --mesh they are the chairs of "
    "nablahog.sample_chairs().",
    "azimuth": "Degrees that the camera is turned about the object's vertical axis: 0 sees the front, 90 the side that "
    "is on the object's left, which is the viewer's right.",
    "elevation": "Degrees that the camera is above the object.",
    "theta": "Degrees that the picture is turned counter-clockwise.",
    "distance": "From the camera to the middle of the object, in diagonals of its bounding box. It "
    "depends on the focal length: one photograph hardly determines both.",
    "distance_in_file_units": "The same in the units of the model's file.",
    "x, y": "Pixels to the right and down from the middle of the photograph to the middle of the object.",
    "focal_length": "Of the camera of the pose, in pixels of the photograph.",
    "focal_length_from": "given: by an option; exif: by the photograph's file; assumed: such that an object that fills "
    "its box is 3 of its diagonals away, so that distances are no true ones.",
    "matrix, intrinsics": "A point X of the model's file, (x, y, z, 1), is seen at intrinsics (3x3) times the upper "
    "three rows of matrix (4x4) times X, divided by the last coordinate: OpenCV's convention. Where the focal length "
    "is assumed, the principal point is that of a camera that looks straight at the object.",
    "confidence": "The probability that the azimuth is within 15° of the true one, or of one from which the model "
    "looks the same, as measured on rendered scenes and photographs.",
    "renderings": "How many the search has made, of all candidates.",
    "seconds": "Wall time of the search; the first in a process takes longer, while code is compiled or loaded.",
}
"""What the figures mean, except the similarity."""

SIMILARITIES = {
    "patches": "The sum over the visual elements of the photograph of the dot products of the ∇HOG descriptors of "
    "their patches with those of the same patches of the rendering, each patch an image of its own, as in the paper.",
    "whitened": "The sum over the same elements of dot products in the descriptor of the whole window, of which the "
    "photograph's are whitened by the background: structure that is common in photographs has little weight.",
    "calibrated": "The score of the rendering's linear discriminant on the whole window of the photograph, in "
    "standard deviations over arbitrary photographs. The last steps of the method best, and the similarity that it "
    "reports, use cells of half the size.",
}
"""What the similarity means, by its kind."""

LEAST = 5.0
"""A calibrated similarity below which a pose may mean nothing: 9 of 10 boxes of photographs without any chair stay
below it (48 boxes, 24 models), and none of 48 scenes with one of the models (``benchmarks/unrelated_poses.py`` of
revision 6cd399d)."""

_POSE = ("model", "azimuth", "elevation", "theta", "distance")  # of an estimate
_UNITS = {
    "azimuth, elevation, theta": "degrees",
    "distance": "diagonals of the model's bounding box",
    "distance_in_file_units": "those of the model's file",
    "matrix": "of its last column those of the model's file",
    "intrinsics, principal_point": "pixels of the photograph",
    "image_size": "height, width in pixels",
    "box": "x0, y0, x1, y1 in pixels from the upper left corner of the photograph",
    "x, y, focal_length": "pixels of the photograph",
    "crop": "side in pixels; zoom: its pixels for one of the photograph; middle: x, y in the photograph",
    "around, traces": "azimuths in degrees; derivatives of the similarity per degree",
    "cosine, opendr_cosine": f"of central differences over ±{STEP:g}° with the derivatives, and with those of OpenDR's "
    "renderer at one sample a pixel",
    "equivalent_azimuths": "degrees; from these the model looks the same",
    "runners_up": "the best poses from other sides; share: of the best pose's similarity",
    "elements": "rows, columns of cells of the crop",
}


class Around(NamedTuple):
    """Similarities at :data:`AZIMUTHS` equidistant azimuths from 0° on, and derivatives by azimuth, per degree.

    Attributes:
        similarities: with :data:`SAMPLES` samples along the side of a pixel.
        derivatives: of these, by the area that edges cover.
        differences: central differences of these over ±:data:`STEP`.
        opendr: OpenDR's derivatives with one sample a pixel, as the paper's search has them.
    """

    similarities: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    differences: NDArray[np.float64]
    opendr: NDArray[np.float64]

    @property
    def cosine(self) -> float:
        """Between the derivatives and the central differences."""
        return _cosine(self.derivatives, self.differences)

    @property
    def opendr_cosine(self) -> float:
        """Between OpenDR's derivatives and the central differences."""
        return _cosine(self.opendr, self.differences)


def camera_figures(estimate: PoseEstimate) -> dict[str, Any]:
    """What is known of the camera, and the pose as a matrix for it, ready for JSON."""
    return {
        "distance_in_file_units": estimate.distance_in_file_units,
        "focal_length": estimate.camera.focal,
        "focal_length_from": estimate.focal_from,
        "principal_point": estimate.principal_point,
        "intrinsics": estimate.intrinsics.tolist(),
        "matrix": estimate.matrix().tolist(),
    }


def _cosine(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return float(one @ other) / max(float(np.linalg.norm(one) * np.linalg.norm(other)), 1e-30)


@dataclass(frozen=True, eq=False)
class PoseResult:
    """A pose estimate with its inputs.

    Attributes:
        photo: the file of the photograph, as the user gave it.
        photograph: (C, H, W) in 0…1.
        box: of the object in it.
        matched: its crop and background.
        estimate: the pose.
        mesh: of the best model.
        models: the file or folder of all models; None for those of :func:`nablahog.sample_chairs`.
        candidates: the names of all models.
        passed_over: why models could not be read, by their names.
        seconds: of the search.
        method, initial, seed: of the search, as :func:`nablahog.estimate_pose` has them.
        background, viewpoint_prior: their files; None for the default ones.
        least_confidence: of a pose that is not refused.
    """

    photo: str
    photograph: Tensor
    box: Box
    matched: PreparedPhotograph
    estimate: PoseEstimate
    mesh: Mesh
    models: str | None
    candidates: Sequence[str]
    passed_over: dict[str, str]
    seconds: float
    method: SearchMethod
    initial: tuple[float, float] | None
    seed: int
    background: str | None
    viewpoint_prior: str | None
    least_confidence: float = 0.0

    def row(self) -> dict[str, object]:
        """The most important figures, for a table."""
        return {
            "photograph": os.fsencode(Path(self.photo).name).decode(errors="backslashreplace"),
            **{name: getattr(self.estimate, name) for name in (*_POSE, "similarity", "confidence", "renderings")},
            **({"azimuth": "any"} if self.estimate.any_azimuth else {}),
            "seconds": self.seconds,
        }

    @property
    def refusal(self) -> str | None:
        """A sentence if the pose is less sure than was asked for."""
        sure = self.estimate.confidence
        if sure is None or sure >= self.least_confidence:
            return None
        return (
            f"the azimuth is within 15 degrees of the true one with a probability of {sure:.2f} only, which is below "
            f"{self.least_confidence:g}: the object may not be there, or be unlike the model"
        )

    @property
    def warning(self) -> str | None:
        """A sentence if the similarity is no larger than in photographs of something else."""
        estimate = self.estimate
        if estimate.similarity_kind != "calibrated" or estimate.similarity >= LEAST:
            return None
        return (
            f"the similarity, {estimate.similarity:.1f}, is below {LEAST:g}, as models mostly have it in photographs "
            "of something else: this pose may mean nothing"
        )

    def definitions(self) -> dict[str, str]:
        """What the figures of :meth:`row` mean."""
        definitions = self._definitions()
        return {name: definitions[name] for name in self.row() if name in definitions}

    def _definitions(self) -> dict[str, str]:
        return {**DEFINITIONS, "similarity": SIMILARITIES[self.estimate.similarity_kind]}

    def figures(self) -> dict[str, Any]:
        """All figures, ready for JSON."""
        estimate, spec = self.estimate, self.matched.background.spec
        _, parts = self.matched.elements
        return {
            "photograph": self.photo,
            "image_size": list(self.photograph.shape[1:]),
            "box": list(self.box),
            **{name: getattr(estimate, name) for name in (*_POSE, "x", "y")},
            **camera_figures(estimate),
            "any_azimuth": estimate.any_azimuth,
            "equivalent_azimuths": list(estimate.equivalent_azimuths),
            "similarity": estimate.similarity,
            "confidence": estimate.confidence,
            "refused": self.refusal is not None,
            "runners_up": [
                {"model": one.model, **dict(zip(PARAMETERS, one.pose.tolist(), strict=True)), "share": one.share}
                for one in estimate.runners_up
            ],
            "warning": self.warning,
            "renderings": estimate.renderings,
            "seconds": round(self.seconds, 4),
            "candidates": list(self.candidates),
            "passed_over": self.passed_over,
            "settings": {
                "mesh": self.models,
                "method": self.method,
                "similarity": estimate.similarity_kind,
                "initial": self.initial,
                "background": self.background,
                "viewpoint_prior": self.viewpoint_prior,
                "descriptor": json.loads(spec.to_json()),
                "seed": self.seed,
            },
            "crop": {"side": SIDE, "zoom": self.matched.crop.zoom, "middle": list(self.matched.crop.middle)},
            "around": {
                "azimuths": (np.arange(AZIMUTHS) * (360 / AZIMUTHS)).tolist(),
                "similarities": self.around.similarities.tolist(),
                "derivatives": self.around.derivatives.tolist(),
                "central_differences": self.around.differences.tolist(),
                "cosine": self.around.cosine,
                "opendr_cosine": self.around.opendr_cosine,
            },
            "traces": [{"azimuths": trace.azimuths, "similarities": trace.similarities} for trace in self.traces],
            "elements": {
                "size": list(ELEMENT),
                "positions": parts.positions.tolist(),
                "discriminability": parts.discriminability.tolist(),
            },
            "units": _UNITS,
            "definitions": self._definitions(),
            "version": version("nablahog"),
        }

    @property
    def traces(self) -> list[SearchTrace]:
        """Of the searches with the best model."""
        return [trace for trace in self.estimate.traces if trace.model == self.estimate.model]

    @cached_property
    def around(self) -> Around:
        """Similarities and derivatives by azimuth at the other parameters of the estimate."""
        poses = self.turned(AZIMUTHS)
        similarity = self._similarity("edges", SAMPLES)
        values, slopes = similarity.derivatives(poses)
        step = poses.new_tensor([STEP, 0, 0, 0, 0, 0])
        differences = (similarity.values(poses + step) - similarity.values(poses - step)) / (2 * STEP)
        opendr = self._similarity("opendr", 1).derivatives(poses)[1]
        return Around(*map(as_array, (values, slopes[:, 0], differences, opendr[:, 0])))

    def _similarity(self, derivative: Method, samples: int) -> Similarity:
        template = self.matched.template(self.estimate.similarity_kind)
        return prepared_model(self.mesh, self.matched.crop.camera).similarity(template, derivative, samples)

    def turned(self, count: int) -> Tensor:
        """Poses for the crop at ``count`` azimuths from 0° on."""
        start = self.estimate.crop_pose.clone()
        start[0] = 0
        return azimuth_sweep(start, count)
