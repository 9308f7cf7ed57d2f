from .background import default_background as default_background, learn_background as learn_background
from .estimate import estimate_pose as estimate_pose
from .photograph import Elements as Elements, elements as elements
from .result import PoseEstimate as PoseEstimate
from .viewpoint_prior import ViewpointPrior as ViewpointPrior, default_viewpoints as default_viewpoints
from .whitening import Background as Background
