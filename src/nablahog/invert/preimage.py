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

    The histograms before normalisation are recovered (:mod:`.histograms`).  Several images with these histograms, the
    samples, are searched from different starts.  Their mean, smoothed, is what the image is expected to be: it leaves
    out what they disagree on.  The answer is an image with this descriptor, close to what is expected.

    An unsigned descriptor has no such samples: they would differ in the signs of whole regions.  What is expected then
    comes from :mod:`.signs`, and of the image and its negative the one that looks more like a photograph is returned
    (:mod:`.polarity`).  A learned prior knows both better.

    Each image has its own steps and its own stop.  A batch therefore gives what its images alone would give, up to
    rounding, which a long search may amplify.  A batch that needs more than half a GiB, or than two fifths of what is
    free on a GPU, is searched in parts, one after the other.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, a tensor on any device or a NumPy array; an array
            also (rows, cols, channels).
        spec: the dialect that made it, or the name of a preset with its defaults.
        image_size: (height, width); by default whole cells, rows · cell height and cols · cell width.
        quality: ``"best"``, or ``"fast"``: an eighth of the evaluations, for a coarser image.
        seed: of the noise that the search starts from.  The same for every image of the batch.
        start: (B, 1, H, W) in 0…1, images to begin with, of any contrast; by default what the votes integrate to.
        expected: (B, 1, H, W) in 0…1, of any contrast, instead of the samples' mean; no samples are drawn.
        prior: a network that was learned for such descriptors, and says what is expected; of unsigned ones also which
            side is bright.  For unsigned ones there may be two, ``[unsigned, signed]``: once an image is found, the
            second says which details to expect of it, and the search goes on near these.  ``"default"`` is what comes
            with the package.
        search: the minimiser, its unknowns and budget, samples, signs and polarity.
        objective: smoothness ξ, closeness λ, and priors.
        progress: called with the evaluations done, by the paper's search the iterations, and the most there can be,
            over all parts of the batch.
        watch: called after each round of evaluations, by the paper's search after each iteration, with the images so
            far, an :class:`.iterate.Iterate`; first with what a prior expects.  An exception that it raises ends the
            search.

    Returns:
        Images (B, 1, H, W) in 0…1, their distances and how the search ended, see :class:`nablahog.Reconstruction`;
        arrays if ``descriptor`` is an array.  They have no derivative by ``descriptor``.

    Raises:
        TypeError: the descriptor, ``start`` or ``expected`` is no floating-point tensor or array.
        ValueError: their shape contradicts spec and image size, they hold NaN or Inf, the spec keeps DPM's texture
            without directed channels, there is no such quality or method, the method does not take an option, or the
            prior is for others.
        FileNotFoundError: the default prior was not installed.

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
