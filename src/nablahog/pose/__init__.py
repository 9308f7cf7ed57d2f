"""Section 3.2 of the paper: the pose of an object from the similarity of HOG descriptors."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .background import default_background, learn_background
    from .estimate import estimate_pose
    from .photograph import Elements, elements
    from .result import PoseEstimate
    from .viewpoint_prior import ViewpointPrior, default_viewpoints
    from .whitening import Background

__all__ = [
    "Background",
    "Elements",
    "PoseEstimate",
    "ViewpointPrior",
    "default_background",
    "default_viewpoints",
    "elements",
    "estimate_pose",
    "learn_background",
]

names_when_used(
    __name__,
    background=("default_background", "learn_background"),
    photograph=("Elements", "elements"),
    estimate=("estimate_pose",),
    result=("PoseEstimate",),
    viewpoint_prior=("ViewpointPrior", "default_viewpoints"),
    whitening=("Background",),
)
