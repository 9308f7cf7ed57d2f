"""Section 3.1, single-scale: pre-images from the descriptor alone, one for each, or several where it leaves room."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..hog.inputs import ArrayImage, Descriptors
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .checks import check_descriptor, check_images, descriptors_as_tensor
from .choices import InversionMethod, QualityName
from .learned import PriorChoice, as_priors
from .options import AsPublished, Objective, Search, as_published
from .published import reconstruct_as_published
from .reconstruction import Reconstruction, Watch, at_start, of_the_kind
from .single_scale import search_preimages


def reconstruct(
    descriptor: Descriptors,
    spec: HOGSpec | str,
    image_size: Sequence[int] | None = None,
    *,
    quality: QualityName = "best",
    method: InversionMethod | AsPublished = "default",
    seed: int = 0,
    start: Tensor | ArrayImage | None = None,
    expected: Tensor | ArrayImage | None = None,
    prior: PriorChoice = None,
    search: Search = Search(),
    objective: Objective = Objective(),
    progress: Callable[[int, int], None] | None = None,
    watch: Watch | None = None,
) -> Reconstruction[Descriptors]:
    """Images whose HOG is the given descriptor, from the descriptor alone, for a whole batch at once.

    First the histograms before normalisation are recovered (:mod:`.histograms`).  Then several images with these
    histograms, the samples, are found from different starts.  Their smoothed mean is the *expected* image, in which
    everything that they disagree on is averaged out.  The result is an image with the given descriptor, close to the
    expected one.

    Samples for an unsigned descriptor would differ in the signs of whole regions.  So the expected image comes from
    estimated signs, and of the image and its negative the one that looks more like a photograph is returned
    (:mod:`.signs`).  A learned prior is better at both.

    Each image has its own steps and its own stop.  So an image has the same result in a batch as alone, up to rounding,
    which a long search may amplify.  A batch that needs more than half a GiB, or more than two fifths of the free
    memory of a GPU, is searched in parts, one after the other.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, a tensor on any device or a NumPy array; an array
            also (rows, cols, channels).
        spec: the dialect that made it, or the name of a preset with its defaults.
        image_size: (height, width) in pixels; by default whole cells, rows · cell height and cols · cell width.
        quality: ``"best"``; or ``"fast"``, with an eighth of the evaluations and a coarser image.
        method: ``"default"``; or ``"paper"``, the paper's own search, whose options an ``invert.AsPublished`` sets.
        seed: of the initial noise, which is the same for every image of the batch.
        start: (B, 1, H, W) in 0…1, initial images, of any contrast; by default the integral of the mean gradients.
        expected: (B, 1, H, W) in 0…1, of any contrast: the expected images; then no samples are drawn.
        prior: a network trained for such descriptors, which predicts the expected image, and for unsigned ones also
            the polarity.  For unsigned descriptors there may be two, ``[unsigned, signed]``: the second adds details
            when an image is found.  ``"default"``: the priors that come with the package.
        search: the minimiser, its budget, and the number of samples.
        objective: smoothness ξ, closeness λ, and priors.
        progress: called with the number of evaluations so far and the largest possible number, over all parts of the
            batch; iterations for the paper's search.
        watch: called with the current images, an :class:`.reconstruction.Iterate`: after each round of evaluations, for
            the paper's search after each iteration, and first with the expected image of a prior.  An exception that it
            raises ends the search.

    Returns:
        Images (B, 1, H, W) in 0…1, their distances and how the search ended, see :class:`nablahog.Reconstruction`;
        arrays if ``descriptor`` is an array.  They have no derivative with respect to ``descriptor``.

    Raises:
        TypeError: the descriptor, ``start`` or ``expected`` is not a floating-point tensor or array.
        ValueError: their shape contradicts spec and image size; they contain NaN or Inf; the spec has DPM's texture
            without directed channels; there is no such quality or method; the method does not have an option; or the
            prior is for other descriptors.
        FileNotFoundError: the default prior is not installed.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), spec)
    >>> nablahog.reconstruct(descriptor, spec, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    >>> nablahog.reconstruct(descriptor[0].numpy(), spec, (32, 32), quality="fast").image.shape  # an array
    (32, 32)
    """
    began = time.perf_counter()
    spec, targets = as_spec(spec), descriptors_as_tensor(descriptor)
    size = check_descriptor(targets, spec, image_size)
    published = as_published(
        method,
        quality=(quality, "best"),
        expected=(expected, None),
        prior=(prior, None),
        search=(search, Search()),
        objective=(objective, Objective()),
    )
    start = check_images("start", start, targets, size, spec)
    targets = targets.detach()
    if watch is not None:
        watch = _in_dialect(watch, spec)
    if published is not None:
        result = reconstruct_as_published(
            targets, spec, size, published, seed=seed, start=start, progress=progress, watch=watch
        )
        return of_the_kind(result, descriptor)
    expected = check_images("expected", expected, targets, size, spec)
    learned = as_priors(prior, spec)
    if learned is not None:
        if expected is not None:
            raise ValueError("expected images and a prior contradict each other: give one of them")
        expected = learned.own.expected(targets, spec, size)
        if watch is not None:
            watch(at_start(expected, targets, spec))
    result = search_preimages(
        targets,
        spec,
        size,
        quality=quality,
        seed=seed,
        start=start,
        expected=expected,
        learned=learned,
        search=search,
        objective=objective,
        progress=progress,
        watch=watch,
    )
    return of_the_kind(replace(result, seconds=time.perf_counter() - began), descriptor)


def _in_dialect(watch: Watch, spec: HOGSpec) -> Watch:
    """``watch`` with images of ``spec``, not of the dialect that is searched with (:func:`.histograms.searchable`)."""
    return lambda now: watch(replace(now, spec=spec))


@dataclass(frozen=True, eq=False)
class Samples:
    """Pre-images of each descriptor that differ in what it leaves open.

    Attributes:
        image: (B, K, 1, H, W) in 0…1.
        distance: (B, K), as in :class:`.reconstruction.Reconstruction`.
        agreement: (B,) in 0…1, the mean over all pairs of two samples of the magnitude of their correlation, which is
            the same for a sample and its negative.
    """

    image: Tensor
    distance: Tensor
    agreement: Tensor


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
        count: K, samples of each descriptor, at least 2.
        prior: a network trained for unsigned descriptors; by default the one that comes with the package.
        quality, search, objective, progress: as in :func:`reconstruct`, for each sample.
        seed: of the draws; the same for every descriptor of the batch.

    Raises:
        TypeError: the descriptor is no float32 or float64 tensor, or there is no prior.
        ValueError: as :func:`reconstruct`; the prior is for signed descriptors; ``count`` is below 2.
        FileNotFoundError: the default prior is not installed.

    >>> descriptor = nablahog.hog(torch.rand(1, 1, 64, 64), "paper")
    >>> samples = nablahog.invert.reconstruct_samples(descriptor, "paper", count=2, quality="fast")
    >>> samples.image.shape, samples.agreement.shape
    (torch.Size([1, 2, 1, 64, 64]), torch.Size([1]))
    """
    if count < 2:
        raise ValueError(f"expected at least 2 samples, got {count}")
    spec = as_spec(spec)
    learned = as_priors(prior, spec)
    if learned is None:
        raise TypeError("prior must be a LearnedPrior, a list of these or 'default', got None")
    size = check_descriptor(descriptor, spec, image_size)
    descriptor = descriptor.detach()
    result = search_preimages(
        descriptor.repeat_interleave(count, dim=0),
        spec,
        size,
        quality=quality,
        seed=seed,
        expected=learned.own.samples(descriptor, spec, size, count, seed=seed).flatten(0, 1),
        learned=learned,
        search=search,
        objective=objective,
        fix_polarity=False,
        progress=progress,
    )
    image = result.image.reshape(-1, count, 1, *size)
    return Samples(image, result.distance.reshape(-1, count), _agreement(image))


def _agreement(images: Tensor) -> Tensor:
    """Images (B, K, 1, H, W) to the mean magnitude of the correlations of two of K, (B,); 0 for flat images."""
    pixels = images.flatten(2)
    pixels = pixels - pixels.mean(dim=2, keepdim=True)
    size = pixels.norm(dim=2, keepdim=True)
    pixels = pixels / torch.where(size > 0, size, 1)
    one, other = torch.triu_indices(images.shape[1], images.shape[1], offset=1)
    return (pixels[:, one] * pixels[:, other]).sum(dim=2).abs().mean(dim=1)
