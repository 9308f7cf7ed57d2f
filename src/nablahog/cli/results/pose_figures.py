"""The figures of a pose estimate, and what they mean."""

from __future__ import annotations

from typing import Any

from ...pose import PoseEstimate
from ...render import PARAMETERS

DEFINITIONS = {
    "model": "The model that fits best, of all candidates. Without --mesh they are those of nablahog.sample_chairs().",
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
    "similarity": "calibrated: the score of the rendering's linear discriminant on the window of the photograph, in "
    "standard deviations over arbitrary photographs; patches: the sum over the photograph's visual elements of the dot "
    "products of the ∇HOG descriptors of their patches with those of the rendering, as in the paper.",
    "confidence": "The probability that the azimuth is within 15° of the true one, or of one from which the model "
    "looks the same, as measured on rendered scenes and photographs.",
    "runners_up": "The best poses from other sides; share: of the best pose's similarity, or of its side's votes.",
    "renderings": "How many the search has compared, of all candidates.",
    "seconds": "Wall time of the search; the first in a process takes longer, while code is loaded.",
}
"""What the figures mean."""

LEAST = 5.0
"""A calibrated similarity below which a pose may mean nothing: 9 of 10 boxes of photographs without any chair stay
below it (48 boxes, 24 models), and none of 48 scenes with one of the models."""


def pose_figures(estimate: PoseEstimate) -> dict[str, Any]:
    """All figures, ready for JSON."""
    return {
        "image_size": [estimate.camera.height, estimate.camera.width],
        "box": list(estimate.box),
        "model": estimate.model,
        **_parameters(estimate),
        "distance_in_file_units": estimate.distance_in_file_units,
        "focal_length": estimate.camera.focal,
        "focal_length_from": estimate.focal_from,
        "principal_point": estimate.principal_point,
        "intrinsics": estimate.intrinsics.tolist(),
        "matrix": estimate.matrix().tolist(),
        "any_azimuth": estimate.any_azimuth,
        "equivalent_azimuths": list(estimate.equivalent_azimuths),
        "similarity": estimate.similarity,
        "similarity_kind": estimate.similarity_kind,
        "confidence": estimate.confidence,
        "warning": warning(estimate),
        "runners_up": [{"model": one.model, **_parameters(one), "share": one.share} for one in estimate.runners_up],
        "renderings": estimate.renderings,
    }


def _parameters(estimate: PoseEstimate) -> dict[str, float]:
    return dict(zip(PARAMETERS, estimate.pose[0].tolist(), strict=True))


def warning(estimate: PoseEstimate) -> str | None:
    """A sentence if the similarity is no larger than in photographs of something else."""
    if estimate.similarity_kind != "calibrated" or estimate.similarity >= LEAST:
        return None
    return (
        f"the similarity, {estimate.similarity:.1f}, is below {LEAST:g}, as models mostly have it in photographs of "
        "something else: this pose may mean nothing"
    )
