"""Section 3.1, multi-scale and multi-scale-more: small images first, each the start of a larger one.

A level of scale s has 1/s of the image's pixels, and cells with sides of 1/√s, so that its grid is the same.
*Multi-scale* matches one descriptor at every level; *multi-scale-more* is given a descriptor for each level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Generic

import numpy as np
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..hog.dialects import as_spec
from ..hog.spec import HOGSpec
from ..inputs.arrays import Descriptors, as_descriptors
from ..inputs.numbers import as_integers, as_seed, as_size, check_callable
from ..runtime.pytorch import in_plain_mode
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
from .choices import InversionMethod
from .histograms import linear_vote_spec, recover_histograms
from .preimage import search_preimages
from .prior.choice import PriorChoice, Priors, as_priors
from .prior.terms import CoarserDescriptor
from .published import choose_smoothness, reconstruct_as_published
from .reconstruction import Reconstruction, Values, convert_like, find_negatives, negate, relative_distance
from .scales import SCALES, level_spec
from .starts import enlarge, starting_images

COARSER_WEIGHT = 0.1  # of the distance at each coarser scale, relative to that at the level's own
COARSE_EVALUATIONS = 120  # most evaluations of an image at each level before the last


@dataclass(frozen=True)
class Level(Generic[Values]):
    """One level of a multi-scale reconstruction.

    Attributes:
        scale: s, the image's pixels over the level's.
        spec: the dialect with the level's cells.
        reconstruction: the pre-images of the level's size.
    """

    scale: int
    spec: HOGSpec
    reconstruction: Reconstruction[Values]


@in_plain_mode
def reconstruct_multiscale(
    descriptors: Descriptors | Sequence[Descriptors],
    spec: HOGSpec | str,
    image_size: Sequence[int] | None = None,
    *,
    scales: Sequence[int] = SCALES,
    method: InversionMethod | AsPublished = "default",
    seed: int = 0,
    prior: PriorChoice = "default",
    search: Search = Search(),
    objective: Objective = Objective(),
    progress: Callable[[int, int], None] | None = None,
) -> list[Level[Descriptors]]:
    """Pre-images at every scale, the smallest first; the last is the answer.

    For a signed spec, each level begins with the enlarged image of the previous level, and draws its own samples.  For
    an unsigned one, samples would differ in the signs of regions, and their mean would be meaningless.  So the first
    level is a single image, and each later level has the image of the previous one as its expected image and adds finer
    details.  The last level decides the polarity of all levels.

    Args:
        descriptors: (B, rows, cols, channels), matched at every level (multi-scale), or one for each scale
            (multi-scale-more, see :func:`.scales.scale_descriptors`).  Arrays as for :func:`.preimage.reconstruct`.
        spec: the dialect at the image's own size, or the name of a preset with its defaults.
        image_size: (height, width); by default whole cells.
        scales: falling square numbers.
        method: as :func:`.preimage.reconstruct`.  The paper's search begins with noise at the first level, and with the
            enlarged image of the previous level at each other one, whether signed or not.
        seed: the seed of the noise, of which an unsigned descriptor's search from a learned prior draws none.
        prior: as :func:`.preimage.reconstruct`.  For a signed descriptor it predicts the expected image of the last
            level.  For an unsigned one it predicts that of the first level, if all levels match one descriptor, and
            the details and the polarity of the last level.
        search: as :func:`.preimage.reconstruct`.  Its evaluations are those of the last level; each other level has a
            quarter of them and at most 120, "few iterations".  Samples are drawn for signed descriptors only.
        objective: as :func:`.preimage.reconstruct`; λ weights the distance to the expected image of a level.
        progress: called with the number of evaluations so far and the largest possible number, over all levels.

    Returns:
        A level for each scale: its scale, and its :class:`nablahog.Reconstruction` with images (B, 1, H, W) in 0…1.

    Raises:
        TypeError, ValueError: as :func:`.preimage.reconstruct`; the scales do not fall, or one does not exist for this
            image and cell size; there is not one descriptor for each.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), spec)
    >>> few = nablahog.invert.Search(max_evaluations=10)
    >>> levels = nablahog.reconstruct_multiscale(descriptor, spec, scales=(4, 1), search=few)
    >>> [tuple(level.reconstruction.image.shape) for level in levels]
    [(1, 1, 16, 16), (1, 1, 32, 32)]
    """
    spec, seed = as_spec(spec), as_seed(seed)
    if progress is not None:
        check_callable("progress", progress, "done, most")
    check_settings(search, objective)
    scales = as_integers("scales", scales)
    same_descriptor = isinstance(descriptors, Tensor | np.ndarray | str) or not isinstance(descriptors, Iterable)
    inputs: list[Any] = [descriptors] * len(scales) if same_descriptor else list(descriptors)
    targets = [as_descriptors("the descriptor", descriptor)[0] for descriptor in inputs]
    published = as_published(
        method, prior=(prior or "default", "default"), search=(search, Search()), objective=(objective, Objective())
    )
    settings = _choose_level_settings(targets, same_descriptor, spec, image_size, scales, search, published)
    learned = as_priors(prior, spec, by_default=published is None and search.samples is None)
    start = expected = None
    if same_descriptor and published is None:
        start, expected = _first_images(settings, spec, seed, learned)
    levels: list[Level] = []
    for number, level in enumerate(settings):
        if levels:
            before = enlarge(levels[-1].reconstruction.image, *level.size)
            start, expected = (before, None) if spec.signed or published is not None else (None, before)
        start, expected = (
            convert_images("start", images, level.descriptor, level.size, level.spec) for images in (start, expected)
        )
        report = _report(progress, settings, number)
        if isinstance(level.options, AsPublished):
            result = reconstruct_as_published(
                level.descriptor, level.spec, level.size, level.options, seed=seed, start=start, progress=report
            )
        else:
            result = search_preimages(
                level.descriptor,
                level.spec,
                level.size,
                seed=seed,
                start=start,
                expected=expected,
                learned=learned if level is settings[-1] else None,
                search=level.options,
                objective=objective if same_descriptor else _add_coarser(objective, settings[:number], level),
                fix_polarity=False,
                progress=report,
            )
        levels.append(Level(level.scale, level.spec, result))
    if not spec.signed and published is None:
        levels = _fix_polarity(levels, [level.descriptor for level in settings])
    return [
        Level(level.scale, level.spec, convert_like(level.reconstruction, descriptor))
        for level, descriptor in zip(levels, inputs, strict=True)
    ]


@dataclass(frozen=True)
class _LevelSettings:
    """The inputs of a level."""

    scale: int
    spec: HOGSpec
    size: tuple[int, int]
    descriptor: Tensor
    options: Search | AsPublished
    most: int  # evaluations, or iterations of the paper's search


def _choose_level_settings(
    descriptors: Sequence[Tensor],
    same_descriptor: bool,
    spec: HOGSpec,
    image_size: Sequence[int] | None,
    scales: Sequence[int],
    search: Search,
    published: AsPublished | None,
) -> list[_LevelSettings]:
    """The inputs of each level, all checked before any work; with ``same_descriptor``, all match one descriptor."""
    if any(a <= b for a, b in pairwise(scales)):
        raise ValueError(f"the scales must fall from level to level, got {tuple(scales)}")
    if len(descriptors) != len(scales):
        raise ValueError(f"expected one descriptor per scale, {len(scales)} in all, got {len(descriptors)}")
    most = search.max_evaluations
    if most is None:
        best = find_quality("best")
        most = best.evaluations if spec.signed else best.without_samples
    # the grid is the same at each level
    size = check_descriptor(descriptors[-1], spec, None) if image_size is None else as_size("image_size", image_size)
    settings: list[_LevelSettings] = []
    for scale, descriptor in zip(scales, descriptors, strict=True):
        small, small_size = level_spec(spec, scale, size)
        check_descriptor(descriptor, *((spec, size) if same_descriptor else (small, small_size)))
        # at the same contrast, 1/s of the pixels with differences √s times as large make 1/√s of the votes
        contrast = scale**0.25 if spec.normalizer.fixes_contrast else 1.0
        target = descriptor.detach() / contrast if same_descriptor and contrast != 1 else descriptor.detach()
        last = len(settings) + 1 == len(scales)
        budget = most if last else min(COARSE_EVALUATIONS, max(2, most // 4))
        options: Search | AsPublished = replace(
            search, max_evaluations=budget, samples=search.samples if spec.signed else 1
        )
        if published is not None:
            budget = published.iterations if last else max(1, published.iterations // 4)
            # with ξ scaled like the descriptor, the smoothness has the same share as at full size
            options = replace(published, iterations=budget, smoothness=choose_smoothness(published, spec) / contrast)
        settings.append(_LevelSettings(scale, small, small_size, target, options, budget))
    return settings


def _report(
    progress: Callable[[int, int], None] | None, settings: Sequence[_LevelSettings], number: int
) -> Callable[[int, int], None] | None:
    """``progress`` over all levels, called by the level ``number``."""
    before, most = (sum(level.most for level in levels) for levels in (settings[:number], settings))
    return None if progress is None else lambda done, _: progress(before + done, most)


def _add_coarser(objective: Objective, before: Sequence[_LevelSettings], level: _LevelSettings) -> Objective:
    """``objective``, and that the image, shrunk, has the descriptors of the levels ``before``."""
    priors = list(objective.priors)
    for small in before:
        factor = level.size[0] // small.size[0]
        priors.append(CoarserDescriptor(COARSER_WEIGHT, small.descriptor, linear_vote_spec(small.spec), factor))
    return replace(objective, priors=priors)


def _fix_polarity(levels: list[Level], descriptors: Sequence[Tensor]) -> list[Level]:
    """Each image or its negative: the last level, which shows most, decides for all."""
    last = levels[-1].reconstruction
    negative, confidence = find_negatives(last.image, last.polarity_confidence)
    fixed = []
    for level, descriptor in zip(levels, descriptors, strict=True):
        image = negate(level.reconstruction.image, negative)
        distance = relative_distance(image, descriptor, level.spec)
        regions = level.reconstruction.region_confidence
        result = replace(
            level.reconstruction,
            image=image,
            distance=distance,
            polarity_confidence=confidence,
            region_confidence=None if regions is None else negate(regions, negative),
        )
        fixed.append(replace(level, reconstruction=result))
    return fixed


def _first_images(
    settings: Sequence[_LevelSettings], spec: HOGSpec, seed: int, learned: Priors | None
) -> tuple[Tensor | None, Tensor | None]:
    """Start and expected image of the first level, where all levels match one descriptor.

    Both are made at full size and shrunk: cells of many pixels determine them better.
    """
    first, last = settings[0], settings[-1]
    factor = last.size[0] // first.size[0]
    if learned is not None and not spec.signed:
        return None, avg_pool2d(learned.prior.expected(last.descriptor, spec, last.size), factor)
    starts = starting_images(recover_histograms(last.descriptor, spec, last.size), spec, *last.size, 1, seed)
    return avg_pool2d(starts[:, 0], factor), None
