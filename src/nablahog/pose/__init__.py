"""Section 3.2 of the paper: the pose of an object from the similarity of HOG descriptors."""

from .background import default_background, learn_background
from .canvas import Box
from .elements import Elements, elements
from .estimate import PoseEstimate, estimate_pose
from .whitening import Background

__all__ = [
    "Background",
    "Box",
    "Elements",
    "PoseEstimate",
    "default_background",
    "elements",
    "estimate_pose",
    "learn_background",
]
