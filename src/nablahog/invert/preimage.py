"""Section 3.1, single-scale: a pre-image from the descriptor alone.

descriptor → histograms before Eq. 7 → where to start, and what to expect → Eq. 8-9 → minimiser → image
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..hog.inputs import ArrayImage, Descriptors
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .checks import check_descriptor, check_images, descriptors_as_tensor
from .histograms import recover_histograms, searchable
from .method import AsPublished, InversionMethod, as_published, check_default_only
from .options import Objective, Search
from .parameterize import low_pass
from .polarity import negated, negatives
from .prior_choice import PriorChoice, as_prior
from .priors import Prior, Range, RelativeSmoothness
from .published import reconstruct_as_published
from .quality import QualityName, quality_of
from .reconstruction import Reconstruction, of_the_kind, relative_distance, to_unit_range
from .search import PreimageSearch
from .start import NOISE, at_contrast, in_pairs, noise, starting_images

SHARE_OF_SAMPLES = 0.7  # of the evaluations, the rest goes to the descriptor itself
LEAST_EVALUATIONS = 28  # of a sample: fewer evaluations make fewer samples
RANGE_WEIGHT = 100.0  # of mean squares of gray values
SPREAD = 0.3  # standard deviation, in 0…1, of the noise the samples begin with, to differ in all that is left open
ENOUGH = 90  # evaluations of a sample, to explain so much away: with fewer it begins with less
SMOOTHING = 0.9  # pixels: what the samples agree on is coarser
MEMORY = 2**29  # bytes that the searches of a part of a batch take, about
VECTORS = 32  # of unknowns that a search of one image holds at most: measured, memory and images and all copies


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
) -> Reconstruction[Descriptors]:
    """Images whose HOG is the given descriptor, from the descriptor alone, for a whole batch at once.

    The histograms before normalisation are recovered (:mod:`.histograms`).  Several images with these histograms, the
    samples, are searched from different starts.  Their mean, smoothed, is what the image is expected to be: it leaves
    out what they disagree on.  The answer is an image with this descriptor, close to what is expected.

    An unsigned descriptor has no such samples: they would differ in the signs of whole regions.  What is expected then
    comes from :mod:`.signs`, and of the image and its negative the one that looks more like a photograph is returned
    (:mod:`.polarity`).  A learned prior knows both better.

    Each image has its own steps and its own stop.  A batch therefore gives what its images alone would give, up to
    rounding, which a long search may amplify.  A batch that needs more than half a GiB (:data:`MEMORY`) is searched in
    parts, one after the other.

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
            side is bright.  ``"default"`` is the one that comes with the package, for all unsigned descriptors.
        search: the minimiser, its unknowns and budget, samples, signs and polarity.
        objective: smoothness ξ, closeness λ, and priors.
        progress: called with the evaluations done, by the paper's search the iterations, and the most there can be,
            over all parts of the batch.

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
            targets.detach(), spec, size, published, seed=seed, start=first, progress=progress
        )
        return of_the_kind(result, descriptor)
    dialect, spec = spec, searchable(spec)
    rooted = dialect.gamma == "sqrt"
    first = check_images("start", start, targets, size, rooted)
    likely = check_images("expected", expected, targets, size, rooted)
    learned = as_prior(prior, dialect)
    if learned is not None:
        if likely is not None:
            raise ValueError("expected images and a prior contradict each other: give one of them")
        likely = learned.expected(targets.detach(), dialect, size)
    plan = _plan(spec, quality, seed, search, objective, first is not None, likely is not None)
    targets = targets.detach()
    searches, images = [], []
    for part, report in _parts(targets, size, plan, progress):
        own = [prior.of(part) for prior in plan.priors]
        searches.append(PreimageSearch(targets[part], spec, size, own, search, plan.max_evaluations, report))
        own_start, own_expected = (None if batch is None else batch[part] for batch in (first, likely))
        images.append(_preimages(searches[-1], own_start, own_expected, plan))
    image = to_unit_range(torch.cat(images), spec)
    confidence = None if learned is None or spec.signed else learned.polarity_confidence(image, targets, dialect)
    if search.polarity and not spec.signed:
        negative, confidence = negatives(image, confidence)
        image = negated(image, negative)
    if rooted:
        image = image.square()
    length = max(len(each.history()) for each in searches)
    result = Reconstruction(
        image,
        relative_distance(image, targets, dialect),
        [reason for each in searches for reason in each.stop_reason],
        torch.cat([each.history(length) for each in searches], dim=1),
        torch.cat([each.evaluations for each in searches]),
        time.perf_counter() - began,
        polarity_confidence=confidence,
    )
    return of_the_kind(result, descriptor)


@dataclass(frozen=True)
class _Plan:
    """The options of a reconstruction, with all defaults filled in; ``samples`` is 1 where none are drawn."""

    seed: int
    region_signs: bool
    max_evaluations: int
    samples: int
    on_histograms: int
    closeness: float
    priors: tuple[Prior, ...]


def _plan(
    spec: HOGSpec,
    quality: QualityName,
    seed: int,
    search: Search,
    objective: Objective,
    has_start: bool,
    has_expected: bool,
) -> _Plan:
    effort = quality_of(quality)
    samples = effort.samples if search.samples is None else search.samples
    if has_expected or not (spec.signed or has_start):
        samples = 1
    max_evaluations = search.max_evaluations
    if max_evaluations is None:
        max_evaluations = effort.evaluations if samples > 1 else effort.without_samples
    closeness = objective.closeness
    if closeness is None:
        closeness = 1.0 if spec.signed else 0.1
    smoothness = (RelativeSmoothness(objective.smoothness),) if objective.smoothness else ()
    gray_values = (Range(RANGE_WEIGHT),) if spec.normalizer.fixes_contrast else ()
    priors = (*smoothness, *gray_values, *objective.priors)
    return _Plan(seed, search.region_signs, max_evaluations, samples, effort.on_histograms, closeness, priors)


def _parts(
    descriptor: Tensor, size: tuple[int, int], plan: _Plan, progress: Callable[[int, int], None] | None
) -> Iterator[tuple[slice, Callable[[int, int], None] | None]]:
    """Parts of a batch that fit into :data:`MEMORY`, each with its share of ``progress``."""
    height, width = size
    at_once = max(1, MEMORY // (plan.samples * VECTORS * height * width * descriptor.element_size()))
    count = -(-len(descriptor) // at_once)

    def share(number: int) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, most: progress(number * most + done, count * most)

    for number in range(count):
        yield slice(number * at_once, (number + 1) * at_once), share(number)


def _preimages(search: PreimageSearch, start: Tensor | None, expected: Tensor | None, plan: _Plan) -> Tensor:
    """Images (B, 1, H, W) that have the descriptors, of any contrast."""
    spec, (height, width) = search.spec, search.size
    votes = recover_histograms(search.descriptor, spec, search.size, max_evaluations=plan.on_histograms)
    if expected is None and start is None and not spec.signed:
        if plan.region_signs:
            expected = starting_images(votes, spec, height, width, 1, plan.seed)[:, 0]
        else:
            start = 0.5 + noise(votes, height, width, 1, plan.seed)[:, 0].expand(len(votes), -1, -1, -1)
    if expected is None:
        start, expected = _mean_of_samples(search, votes, start, plan)
    else:
        start, expected = _near_expected(votes, spec, start, expected, plan.seed)
    return search.match(start.unsqueeze(1), None, search.left(), expected, plan.closeness)[:, 0]


def _mean_of_samples(
    search: PreimageSearch, votes: Tensor, start: Tensor | None, plan: _Plan
) -> tuple[Tensor, Tensor | None]:
    """Where to start, and what to expect: the mean of images with the histograms ``votes``; nothing of a single one."""
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
    """Where to start, and what to expect, at the contrast of the histograms ``votes``."""
    expected = at_contrast(expected, votes, spec)
    start = expected if start is None else at_contrast(start, votes, spec)
    constant = (start == start[..., :1, :1]).flatten(1).all(dim=1)
    if constant.any():  # there all derivatives vanish, and no search would leave it
        height, width = start.shape[2:]
        grainy = start + noise(votes, height, width, 1, seed)[:, 0]
        start = torch.where(constant.reshape(-1, 1, 1, 1), grainy, start)
    return start, expected
