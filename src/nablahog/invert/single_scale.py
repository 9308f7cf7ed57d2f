"""Section 3.1, single-scale: the search for pre-images.

descriptor → histograms before Eq. 7 → start and expected image → Eq. 8-9 → minimiser → image
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..hog.descriptor import hog
from ..hog.presets import uoctti
from ..hog.spec import HOGSpec
from ..runtime.pytorch import memory_for
from .choices import QualityName
from .cosine import low_pass
from .histograms import recover_histograms, searchable
from .learned import LearnedPrior, Priors
from .options import Objective, Search, quality_of
from .priors import Prior, Range, RelativeSmoothness
from .reconstruction import Reconstruction, Watch, relative_distance, share_of, to_unit_range
from .search import PreimageSearch
from .signs import negated, negatives
from .start import NOISE, at_contrast, in_pairs, noise, starting_images

SHARE_OF_SAMPLES = 0.7  # of the evaluations; the rest goes to the descriptor itself
LEAST_EVALUATIONS = 28  # of a sample: with a smaller budget fewer samples are drawn
RANGE_WEIGHT = 100.0  # of mean squares of gray values
SPREAD = 0.3  # standard deviation of the samples' initial noise, in 0…1, so that they differ in all that is left open
ENOUGH = 90  # evaluations of a sample that remove so much noise; with fewer it begins with less
SMOOTHING = 0.9  # pixels: the samples agree on coarser structures only
CLOSENESS, UNCERTAIN = 1.0, 0.1  # λ by default, and of what is expected for unsigned descriptors, before details
BY_PRIOR = 3.0  # λ of a learned prior for signed descriptors, chosen on photographs held out of its training
BEFORE_DETAILS = 0.3  # of the evaluations of an unsigned descriptor, where a second prior adds details
MEMORY = 2**29  # bytes, about, that a part of a batch takes on a CPU
SHARE = 0.4  # of a GPU's free memory, instead
VECTORS = 32  # of unknowns that the search of one image holds at most, all copies included; measured
GRAPH = 256  # the same for the graph that a dogleg keeps on a GPU, where more is searched at once; an estimate


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
    """The search of :func:`.preimage.reconstruct`, for valid arguments.

    ``start`` and ``expected`` are roots where the dialect describes roots.  ``learned`` gives the details and the
    confidence in the polarity; its expected image is passed as ``expected``.  With ``fix_polarity``, of the image for
    an unsigned descriptor and its negative the likelier one is returned.
    """
    spec = searchable(dialect)
    plan = _plan(spec, quality, seed, search, objective, start is not None, expected is not None, learned is not None)
    details = None if learned is None else learned.details
    searches, images = [], []
    for part, report in _parts(targets, size, plan, search, progress):
        own = [prior.of(part) for prior in plan.priors]
        searches.append(
            PreimageSearch(targets[part], spec, size, own, search.minimiser, plan.max_evaluations, report, watch, part)
        )
        own_start, own_expected = (None if batch is None else batch[part] for batch in (start, expected))
        images.append(_preimages(searches[-1], own_start, own_expected, details, plan))
    image = to_unit_range(torch.cat(images), spec)
    confidence = None if learned is None or spec.signed else learned.own.polarity_confidence(image, targets, dialect)
    if fix_polarity and not spec.signed:
        negative, confidence = negatives(image, confidence)
        image = negated(image, negative)
    if dialect.gamma == "sqrt":
        image = image.square()
    length = max(len(each.history()) for each in searches)
    return Reconstruction(
        image,
        relative_distance(image, targets, dialect),
        [reason for each in searches for reason in each.stop_reason],
        torch.cat([each.history(length) for each in searches], dim=1),
        torch.cat([each.evaluations for each in searches]),
        seconds=0.0,
        polarity_confidence=confidence,
    )


@dataclass(frozen=True)
class _Plan:
    """The options of a reconstruction, with all defaults filled in; ``samples`` is 1 where none are drawn."""

    seed: int
    max_evaluations: int
    samples: int
    on_histograms: int
    closeness: float
    closeness_to_details: float
    priors: tuple[Prior, ...]


def _plan(
    spec: HOGSpec,
    quality: QualityName,
    seed: int,
    search: Search,
    objective: Objective,
    has_start: bool,
    has_expected: bool,
    has_prior: bool,
) -> _Plan:
    effort = quality_of(quality)
    samples = effort.samples if search.samples is None else search.samples
    if has_expected or not (spec.signed or has_start):
        samples = 1
    max_evaluations = search.max_evaluations
    if max_evaluations is None:
        max_evaluations = effort.evaluations if samples > 1 else effort.without_samples
    of_signed = BY_PRIOR if has_prior else CLOSENESS
    closeness, to_details = of_signed if spec.signed else UNCERTAIN, CLOSENESS
    if objective.closeness is not None:
        closeness = to_details = objective.closeness
    smoothness = (RelativeSmoothness(objective.smoothness),) if objective.smoothness else ()
    gray_values = (Range(RANGE_WEIGHT),) if spec.normalizer.fixes_contrast else ()
    priors = (*smoothness, *gray_values, *objective.priors)
    return _Plan(seed, max_evaluations, samples, effort.on_histograms, closeness, to_details, priors)


def _parts(
    descriptor: Tensor,
    size: tuple[int, int],
    plan: _Plan,
    search: Search,
    progress: Callable[[int, int], None] | None,
) -> Iterator[tuple[slice, Callable[[int, int], None] | None]]:
    """Parts of a batch that fit into memory, each with its share of ``progress``."""
    height, width = size
    vectors = VECTORS + GRAPH * (search.minimiser == "dogleg" and descriptor.device.type != "cpu")
    of_one = plan.samples * vectors * height * width * descriptor.element_size()
    at_once = max(1, memory_for(descriptor.device, MEMORY, SHARE) // of_one)
    count = -(-len(descriptor) // at_once)
    for number in range(count):
        yield slice(number * at_once, (number + 1) * at_once), share_of(progress, number, count)


def _preimages(
    search: PreimageSearch, start: Tensor | None, expected: Tensor | None, details: LearnedPrior | None, plan: _Plan
) -> Tensor:
    """Images (B, 1, H, W) that have the descriptors, of any contrast."""
    spec, (height, width) = search.spec, search.size
    votes = recover_histograms(search.descriptor, spec, search.size, max_evaluations=plan.on_histograms)
    if expected is None and start is None and not spec.signed:
        expected = starting_images(votes, spec, height, width, 1, plan.seed)[:, 0]
    if expected is None:
        start, expected = _mean_of_samples(search, votes, start, plan)
    else:
        start, expected = _near_expected(votes, spec, start, expected, plan.seed)
    if details is None:
        return search.match(start.unsqueeze(1), None, search.left(), expected, plan.closeness)[:, 0]
    budget = max(1, round(BEFORE_DETAILS * search.left()))
    image = search.match(start.unsqueeze(1), None, budget, expected, plan.closeness)[:, 0]
    expected = at_contrast(_detailed(image, spec, details), votes, spec)
    return search.match(expected.unsqueeze(1), None, search.left(), expected, plan.closeness_to_details)[:, 0]


def _detailed(images: Tensor, spec: HOGSpec, details: LearnedPrior) -> Tensor:
    """The images that ``details`` expects for the signed descriptors of images (B, 1, H, W)."""
    directed = replace(uoctti(spec.cell_size), partial_cells=spec.partial_cells)
    images = to_unit_range(images, directed)
    return details.expected(hog(images, directed), directed, (images.shape[2], images.shape[3]))


def _mean_of_samples(
    search: PreimageSearch, votes: Tensor, start: Tensor | None, plan: _Plan
) -> tuple[Tensor, Tensor | None]:
    """Start and expected image: the mean of samples with the histograms ``votes``; a single one is only a start."""
    spec, (height, width) = search.spec, search.size
    evaluations = max(1, min(search.max_evaluations - 1, round(SHARE_OF_SAMPLES * search.max_evaluations)))
    count = max(1, min(plan.samples, evaluations // LEAST_EVALUATIONS))
    spread = NOISE if count == 1 else SPREAD * min(1, evaluations // count / ENOUGH)
    if start is None:
        starts = starting_images(votes, spec, height, width, count, plan.seed, spread)
    else:
        grain = in_pairs(votes, height, width, count, plan.seed, spread)
        starts = at_contrast(start, votes, spec).unsqueeze(1) + grain
    mean = search.match(starts, votes, evaluations // count).mean(dim=1)
    if count == 1:
        return mean, None
    mean = low_pass(mean, SMOOTHING)
    return mean, mean


def _near_expected(
    votes: Tensor, spec: HOGSpec, start: Tensor | None, expected: Tensor, seed: int
) -> tuple[Tensor, Tensor]:
    """Start and expected image at the contrast of the histograms ``votes``."""
    expected = at_contrast(expected, votes, spec)
    start = expected if start is None else at_contrast(start, votes, spec)
    constant = (start == start[..., :1, :1]).flatten(1).all(dim=1)
    if constant.any():  # all derivatives vanish there, so no search would leave it
        height, width = start.shape[2:]
        grainy = start + noise(votes, height, width, 1, seed)[:, 0]
        start = torch.where(constant.reshape(-1, 1, 1, 1), grainy, start)
    return start, expected
