"""Section 3.1: descriptor to pre-image."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .iterate import Iterate
    from .learned import LearnedPrior
    from .method import AsPublished
    from .multiscale import Level, reconstruct_multiscale, scale_descriptors
    from .options import Objective, Search
    from .preimage import reconstruct
    from .prior_choice import default_prior
    from .reconstruction import Reconstruction
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
    iterate=("Iterate",),
    learned=("LearnedPrior",),
    method=("AsPublished",),
    multiscale=("Level", "reconstruct_multiscale", "scale_descriptors"),
    options=("Objective", "Search"),
    preimage=("reconstruct",),
    prior_choice=("default_prior",),
    reconstruction=("Reconstruction",),
    samples=("Samples", "reconstruct_samples"),
    template=("reconstruct_template", "template_descriptor"),
    training=("train_prior",),
)
