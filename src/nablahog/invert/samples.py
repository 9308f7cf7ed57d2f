"""Several pre-images of each unsigned descriptor, which differ in what it leaves open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..hog.dialects import as_spec
from ..hog.spec import HOGSpec
from ..inputs.arrays import as_descriptors
from ..inputs.numbers import as_integer, as_seed
from ..runtime.pytorch import in_plain_mode
from .arguments import MOST_SAMPLES, Objective, Search, check_descriptor, check_settings
from .choices import QualityName
from .preimage import search_preimages
from .prior.choice import PriorChoice, as_priors


@dataclass(frozen=True, eq=False)
class Samples:
    """Pre-images of each descriptor that differ in what it leaves open.

    Attributes:
        image: (B, K, 1, H, W) in 0…1.
        distance: (B, K), as in :class:`.reconstruction.Reconstruction`.
        agreement: (B,) in 0…1, the mean over all pairs of two samples of the magnitude of their correlation, which is
            the same for a sample and its negative.  All samples can share a mistake.
    """

    image: Tensor
    distance: Tensor
    agreement: Tensor


@in_plain_mode
def reconstruct_samples(
    descriptor: Tensor,
    spec: HOGSpec | str,
    image_size: Sequence[int] | None = None,
    *,
    count: int = 4,
    prior: PriorChoice = "default",
    quality: QualityName = "best",
    seed: int = 0,
    search: Search = Search(),
    objective: Objective = Objective(),
    progress: Callable[[int, int], None] | None = None,
) -> Samples:
    """Several pre-images of each unsigned descriptor, each near another draw from the prior.

    See :meth:`.learned.LearnedPrior.samples`.  The polarity of a sample is drawn, too: where the prior is 70 % sure of
    it, three samples of ten are negatives.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, on any device.
        spec: the dialect that made it, or the name of a preset with its defaults.
        image_size: (height, width); by default whole cells.
        count: K, samples of each descriptor, 2 … 10,000.
        prior: a network trained for unsigned descriptors; by default the one that comes with the package.
        quality, search, objective, progress: as in :func:`reconstruct`, for each sample.
        seed: the seed of the draws; the same for every descriptor of the batch.

    Raises:
        TypeError: the descriptor is no float32 or float64 tensor, or there is no prior.
        ValueError: as :func:`reconstruct`; the prior is for signed descriptors; ``count`` is not in 2 … 10,000.
        FileNotFoundError: the default prior is not installed.

    >>> descriptor = nablahog.hog(torch.rand(1, 1, 64, 64), "paper")
    >>> samples = nablahog.invert.reconstruct_samples(descriptor, "paper", count=2, quality="fast")
    >>> samples.image.shape, samples.agreement.shape
    (torch.Size([1, 2, 1, 64, 64]), torch.Size([1]))
    """
    count, seed, spec = as_integer("count", count, 2, MOST_SAMPLES), as_seed(seed), as_spec(spec)
    check_settings(search, objective)
    learned = as_priors(prior, spec)
    if learned is None:
        raise TypeError("prior must be a LearnedPrior, a list of these or 'default', got None")
    descriptor, _ = as_descriptors("the descriptor", descriptor)
    size = check_descriptor(descriptor, spec, image_size)
    descriptor = descriptor.detach()
    result = search_preimages(
        descriptor.repeat_interleave(count, dim=0),
        spec,
        size,
        quality=quality,
        seed=seed,
        expected=learned.prior.samples(descriptor, spec, size, count, seed=seed).flatten(0, 1),
        learned=learned,
        search=search,
        objective=objective,
        fix_polarity=False,
        progress=progress,
    )
    image = result.image.reshape(-1, count, 1, *size)
    return Samples(image, result.distance.reshape(-1, count), _measure_agreement(image))


def _measure_agreement(images: Tensor) -> Tensor:
    """Images (B, K, 1, H, W) to the mean magnitude of the correlations of all pairs, (B,); 0 for flat images."""
    pixels = images.flatten(2)
    pixels = pixels - pixels.mean(dim=2, keepdim=True)
    size = pixels.norm(dim=2, keepdim=True)
    pixels = pixels / torch.where(size > 0, size, 1)
    first, second = torch.triu_indices(images.shape[1], images.shape[1], offset=1)
    return (pixels[:, first] * pixels[:, second]).sum(dim=2).abs().mean(dim=1)
