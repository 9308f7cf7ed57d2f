"""Section 3.1: descriptor to pre-image."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .learned import LearnedPrior, default_prior
    from .multiscale import Level, reconstruct_multiscale, scale_descriptors
    from .options import AsPublished, Objective, Search
    from .preimage import Samples, reconstruct, reconstruct_samples
    from .reconstruction import Iterate, Reconstruction
    from .template import reconstruct_template, template_descriptor
    from .training import train_prior

__all__ = [
    "AsPublished",
    "Iterate",
    "LearnedPrior",
    "Level",
    "Objective",
    "Reconstruction",
    "Samples",
    "Search",
    "default_prior",
    "reconstruct",
    "reconstruct_multiscale",
    "reconstruct_samples",
    "reconstruct_template",
    "scale_descriptors",
    "template_descriptor",
    "train_prior",
]

names_when_used(
    __name__,
    learned=("LearnedPrior", "default_prior"),
    multiscale=("Level", "reconstruct_multiscale", "scale_descriptors"),
    options=("AsPublished", "Objective", "Search"),
    preimage=("Samples", "reconstruct", "reconstruct_samples"),
    reconstruction=("Iterate", "Reconstruction"),
    template=("reconstruct_template", "template_descriptor"),
    training=("train_prior",),
)
