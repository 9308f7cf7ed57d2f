"""Section 3.1: descriptor to pre-image."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .learned import LearnedPrior
    from .multiscale import Level, reconstruct_multiscale, scale_descriptors
    from .preimage import Reconstruction, reconstruct
    from .template import template_descriptor
    from .training import train_prior

__all__ = [
    "LearnedPrior",
    "Level",
    "Reconstruction",
    "reconstruct",
    "reconstruct_multiscale",
    "scale_descriptors",
    "template_descriptor",
    "train_prior",
]

names_when_used(
    __name__,
    learned=("LearnedPrior",),
    multiscale=("Level", "reconstruct_multiscale", "scale_descriptors"),
    preimage=("Reconstruction", "reconstruct"),
    template=("template_descriptor",),
    training=("train_prior",),
)
