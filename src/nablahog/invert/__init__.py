"""Section 3.1: descriptor to pre-image."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .arguments import AsPublished, Objective, Search
    from .learned import LearnedPrior, default_prior
    from .multiscale import Level, reconstruct_multiscale, scale_descriptors
    from .preimage import reconstruct
    from .reconstruction import Iterate, Reconstruction
    from .samples import Samples, reconstruct_samples
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
    arguments=("AsPublished", "Objective", "Search"),
    preimage=("reconstruct",),
    samples=("Samples", "reconstruct_samples"),
    reconstruction=("Iterate", "Reconstruction"),
    template=("reconstruct_template", "template_descriptor"),
    training=("train_prior",),
)
