"""Section 3.1: descriptor to pre-image."""

from .learned import LearnedPrior
from .multiscale import Level, reconstruct_multiscale, scale_descriptors
from .preimage import Reconstruction, reconstruct
from .training import train_prior

__all__ = [
    "LearnedPrior",
    "Level",
    "Reconstruction",
    "reconstruct",
    "reconstruct_multiscale",
    "scale_descriptors",
    "train_prior",
]
