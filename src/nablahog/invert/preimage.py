"""Section 3.1, single-scale: a pre-image from the descriptor alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from torch import Tensor

from ..hog.inputs import ArrayImage, Descriptors
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .checks import check_descriptor, check_images, descriptors_as_tensor
from .iterate import Watch, at_start
from .method import AsPublished, InversionMethod, as_published, check_default_only
from .options import Objective, Search
from .prior_choice import PriorChoice, as_priors
from .published import reconstruct_as_published
from .quality import QualityName
from .reconstruction import Reconstruction, of_the_kind
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
    histograms, the samples, are found from different starts.  Their smoothed mean is the *expected* image: it does not
    contain what the samples disagree on.  The result is an image with the given descriptor, close to the expected one.

    Samples for an unsigned descriptor would differ in the signs of whole regions.  So the expected image comes from
    :mod:`.signs`, and of the image and its negative the one that looks more like a photograph is returned
    (:mod:`.polarity`).  A learned prior is better at both.

    Each image has its own steps and its own stop.  So an image has the same result in a batch as alone, up to rounding,
    which a long search may amplify.  A batch that needs more than half a GiB, or more than two fifths of the free
    memory of a GPU, is searched in parts, one after the other.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, a tensor on any device or a NumPy array; an array
            also (rows, cols, channels).
        spec: the dialect that made it, or the name of a preset with its defaults.
        image_size: (height, width) in pixels; by default whole cells, rows · cell height and cols · cell width.
        quality: ``"best"``; or ``"fast"``, with an eighth of the evaluations and a coarser image.
        method: ``"default"``; or ``"paper"``, the paper's own search, for which an ``invert.AsPublished`` may set what
            the paper leaves open.
        seed: of the initial noise, which is the same for every image of the batch.
        start: (B, 1, H, W) in 0…1, initial images, of any contrast; by default the integral of the mean gradients.
        expected: (B, 1, H, W) in 0…1, of any contrast: the expected images; then no samples are drawn.
        prior: a network trained for such descriptors, which predicts the expected image, and for unsigned ones also
            which side is bright.  For unsigned descriptors there may be two, ``[unsigned, signed]``: the second adds
            details when an image is found.  ``"default"``: the priors that come with the package.
        search: the minimiser, its unknowns and budget, samples, signs and polarity.
        objective: smoothness ξ, closeness λ, and priors.
        progress: called with the number of evaluations so far and the largest possible number, over all parts of the
            batch; iterations for the paper's search.
        watch: called with the images so far, an :class:`.iterate.Iterate`: after each round of evaluations, for the
            paper's search after each iteration, and first with the expected image of a prior.  An exception that it
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
    published = as_published(method)
    if published is not None:
        check_default_only(
            quality=(quality, "best"),
            expected=(expected, None),
            prior=(prior, None),
            search=(search, Search()),
            objective=(objective, Objective()),
        )
        first = check_images("start", start, targets, size, spec.gamma == "sqrt")
        result = reconstruct_as_published(
            targets.detach(), spec, size, published, seed=seed, start=first, progress=progress, watch=watch
        )
        return of_the_kind(result, descriptor)
    rooted = spec.gamma == "sqrt"
    start = check_images("start", start, targets, size, rooted)
    expected = check_images("expected", expected, targets, size, rooted)
    learned, targets = as_priors(prior, spec), targets.detach()
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
