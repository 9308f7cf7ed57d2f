"""Section 3.1, single-scale: pre-images from the descriptor alone.

descriptor → histograms before Eq. 7 → start and expected image → Eq. 8-9 → minimiser → image
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from ..hog.descriptor import hog
from ..hog.dialects import as_spec
from ..hog.spec import HOGSpec
from ..inputs.arrays import ArrayImage, Descriptors, as_descriptors
from ..inputs.numbers import as_seed, check_callable
from ..runtime.pytorch import in_plain_mode, memory_for
from .arguments import (
    AsPublished,
    Objective,
    Search,
    as_published,
    check_descriptor,
    check_settings,
    convert_images,
    find_quality,
)
from .choices import InversionMethod, QualityName
from .histograms import linear_vote_spec, recover_histograms
from .prior.choice import PriorChoice, Priors, as_priors
from .prior.confidence import Confidence
from .prior.signed_network import INPUT_SPEC
from .prior.terms import GrayRange, Prior, RelativeSmoothness
from .published import reconstruct_as_published
from .reconstruction import (
    Reconstruction,
    Watch,
    build_reconstruction,
    convert_like,
    find_negatives,
    negate,
    split_batch,
    to_unit_range,
)
from .search import PreimageSearch
from .starts import match_contrast, start_near, starting_images

RANGE_WEIGHT = 100.0  # of the mean squared excess of gray values over 0…1
CLOSENESS = 1.0  # λ by default
UNSIGNED_CLOSENESS = 0.1  # λ for the image expected for an unsigned descriptor, before details
PRIOR_CLOSENESS = 3.0  # λ of a learned prior for signed descriptors, chosen on photographs held out of its training
SHARE_BEFORE_DETAILS = 0.3  # share of evaluations for an unsigned descriptor before a second prior adds details
BATCH_MEMORY = 2**29  # bytes, about, that a part of a batch takes on a CPU
BATCH_MEMORY_SHARE = 0.4  # of a GPU's free memory, instead
SEARCH_VECTORS = 32  # of unknowns that the search of one image holds at most, all copies included; measured
GRAPH_VECTORS = 256  # the same for the graph that a dogleg keeps on a GPU, where more is searched at once; an estimate


@in_plain_mode
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
    prior: PriorChoice = "default",
    search: Search = Search(),
    objective: Objective = Objective(),
    progress: Callable[[int, int], None] | None = None,
    watch: Watch | None = None,
) -> Reconstruction[Descriptors]:
    """Images whose HOG is the given descriptor, from the descriptor alone, for a whole batch at once.

    A learned prior predicts the *expected* image of a descriptor, the mean of all photographs that have it.  The result
    is an image with the given descriptor, close to the expected one.

    Without a prior, first the histograms before normalisation are recovered (:mod:`.histograms`).  Then several images
    with these histograms, the samples, are found from different starts.  The expected image is their smoothed mean, in
    which everything that they disagree on is averaged out.  Samples for an unsigned descriptor would differ in the
    signs of whole regions.  So there the expected image comes from estimated signs, and of the image and its negative
    the one that looks more like a photograph is returned (:mod:`.polarity`).

    Each image has its own steps and its own stop.  So an image has the same result in a batch as alone, up to rounding,
    which a long search may amplify.  A batch that needs more than half a GiB, or more than two fifths of the free
    memory of a GPU, is searched in parts, one after the other.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, a tensor on any device or a NumPy array; an array
            also (rows, cols, channels).
        spec: the dialect that made it, or the name of a preset with its defaults.
        image_size: (height, width) in pixels; by default whole cells, rows · cell height and cols · cell width.
        quality: ``"best"``; or ``"fast"``, with fewer evaluations, 80, and a coarser image.
        method: ``"default"``; or ``"paper"``, the paper's own search, whose options an ``invert.AsPublished`` sets.
        seed: the seed of the initial noise, which is the same for every image of the batch.  A search from a learned
            prior draws no noise, so there the seed changes nothing; :func:`.samples.reconstruct_samples` draws other
            answers by its seed.
        start: (B, 1, H, W) in 0…1, initial images, of any contrast; by default the integral of the mean gradients.
        expected: (B, 1, H, W) in 0…1, of any contrast: the expected images; then there are no samples and no prior.
        prior: a network trained for such descriptors, which predicts the expected image, and for unsigned ones also
            the polarity.  For unsigned descriptors there may be two, ``[unsigned, signed]``: the second adds details
            when an image is found.  ``"default"``: the priors that come with the package, or none if ``expected`` or
            a number of samples is given.  None: no prior.
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
    spec, seed = as_spec(spec), as_seed(seed)
    for name, callback, given in (("progress", progress, "done, most"), ("watch", watch, "iterate")):
        if callback is not None:
            check_callable(name, callback, given)
    check_settings(search, objective)
    targets, _ = as_descriptors("the descriptor", descriptor)
    size = check_descriptor(targets, spec, image_size)
    published = as_published(
        method,
        quality=(quality, "best"),
        expected=(expected, None),
        prior=(prior or "default", "default"),
        search=(search, Search()),
        objective=(objective, Objective()),
    )
    start = convert_images("start", start, targets, size, spec)
    targets = targets.detach()
    if published is not None:
        result = reconstruct_as_published(
            targets, spec, size, published, seed=seed, start=start, progress=progress, watch=watch
        )
        return convert_like(result, descriptor)
    expected = convert_images("expected", expected, targets, size, spec)
    learned = as_priors(prior, spec, by_default=expected is None and search.samples is None)
    if learned is not None and expected is not None:
        raise ValueError("expected images and a prior contradict each other: give one of them")
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
    return convert_like(result, descriptor)


def search_preimages(
    targets: Tensor,
    dialect: HOGSpec,
    size: tuple[int, int],
    *,
    quality: QualityName = "best",
    seed: int,
    start: Tensor | None = None,
    expected: Tensor | None = None,
    learned: Priors | None = None,
    search: Search,
    objective: Objective,
    fix_polarity: bool = True,
    progress: Callable[[int, int], None] | None,
    watch: Watch | None = None,
) -> Reconstruction:
    """The search of :func:`reconstruct`, for valid arguments.

    ``start`` and ``expected`` are square roots if the dialect describes these.  ``learned`` predicts expected images
    that are not given, and gives the details and the confidence in the polarity.  With ``fix_polarity``, an image for
    an unsigned descriptor is replaced by its negative if that is likelier.
    """
    began, spec = time.perf_counter(), linear_vote_spec(dialect)
    draws = expected is None and learned is None and (spec.signed or start is not None)
    settings = _choose_settings(spec, quality, seed, search, objective, draws, learned)
    vectors = SEARCH_VECTORS + GRAPH_VECTORS * (search.minimiser == "dogleg" and targets.device.type != "cpu")
    bytes_per_image = settings.samples * vectors * size[0] * size[1] * targets.element_size()
    at_once = max(1, memory_for(targets.device, BATCH_MEMORY, BATCH_MEMORY_SHARE) // bytes_per_image)
    searches, images, confidences = [], [], list[Confidence]()
    for part, report in split_batch(len(targets), at_once, progress):
        priors, budget = [prior.select(part) for prior in settings.priors], settings.max_evaluations
        searches.append(
            PreimageSearch(targets[part], dialect, size, priors, search.minimiser, budget, report, watch, part)
        )
        part_start, part_expected = (None if batch is None else batch[part] for batch in (start, expected))
        image, confidence = _search_part(searches[-1], part_start, part_expected, settings)
        images.append(image)
        confidences += [] if confidence is None else [confidence]
    image = torch.cat(images)
    polarity, regions = map(torch.cat, zip(*confidences, strict=True)) if confidences else (None, None)
    if fix_polarity and not spec.signed:
        negative, polarity = find_negatives(image, polarity)
        image, regions = negate(image, negative), None if regions is None else negate(regions, negative)
    if dialect.gamma == "sqrt":
        image = image.square()
    result = build_reconstruction(image, targets, dialect, searches, began)
    return replace(result, polarity_confidence=polarity, region_confidence=regions)


class _SearchSettings(NamedTuple):
    """The options of a reconstruction, with all defaults filled in; ``samples`` is 1 where none are drawn."""

    seed: int
    max_evaluations: int
    on_histograms: int
    samples: int
    closeness: float
    closeness_to_details: float
    priors: tuple[Prior, ...]
    learned: Priors | None


def _choose_settings(
    spec: HOGSpec,
    quality: QualityName,
    seed: int,
    search: Search,
    objective: Objective,
    draws: bool,
    learned: Priors | None,
) -> _SearchSettings:
    effort = find_quality(quality)
    samples = (search.samples or effort.samples) if draws else 1
    alone = effort.with_prior if learned is not None and spec.signed else effort.without_samples
    most = search.max_evaluations or (effort.evaluations if samples > 1 else alone)
    signed_closeness = CLOSENESS if learned is None else PRIOR_CLOSENESS
    closeness, to_details = signed_closeness if spec.signed else UNSIGNED_CLOSENESS, CLOSENESS
    if objective.closeness is not None:
        closeness = to_details = objective.closeness
    smoothness = (RelativeSmoothness(objective.smoothness),) if objective.smoothness else ()
    gray_values = (GrayRange(RANGE_WEIGHT),) if spec.normalizer.fixes_contrast else ()
    priors = (*smoothness, *gray_values, *objective.priors)
    return _SearchSettings(seed, most, effort.on_histograms, samples, closeness, to_details, priors, learned)


def _search_part(
    search: PreimageSearch, start: Tensor | None, expected: Tensor | None, settings: _SearchSettings
) -> tuple[Tensor, Confidence | None]:
    """Images (B, 1, H, W) in 0…1 that have the descriptors, and how sure their bright side is, if known."""
    spec, size, descriptor, learned = search.spec, search.size, search.descriptor, settings.learned
    histograms = recover_histograms(descriptor, spec, size, max_evaluations=settings.on_histograms)
    if learned is not None and expected is None:
        expected = learned.prior.expected(descriptor, search.dialect, size, histograms)
        search.show_first(expected)
    if expected is None and start is None and not spec.signed:
        expected = starting_images(histograms, spec, *size, 1, settings.seed)[:, 0]
    if expected is None:
        start, expected = search.average_samples(histograms, start, settings.samples, settings.seed)
    else:
        start, expected = start_near(histograms, spec, start, expected, settings.seed)
    if learned is None or learned.details is None:
        image = search.match_descriptor(start, expected, settings.closeness)
    else:
        budget = max(1, round(SHARE_BEFORE_DETAILS * search.remaining_evaluations()))
        image = search.match_descriptor(start, expected, settings.closeness, budget)
        directed = replace(INPUT_SPEC, cell_size=spec.cell_size, partial_cells=spec.partial_cells)
        directed_descriptor = hog(to_unit_range(image, directed), directed)
        expected = match_contrast(learned.details.expected(directed_descriptor, directed, size), histograms, spec)
        image = search.match_descriptor(expected, expected, settings.closeness_to_details)
    image = to_unit_range(image, spec)
    if learned is None or spec.signed:
        return image, None
    return image, learned.prior.confidence(image, descriptor, search.dialect, histograms)
