"""Section 3.1, single-scale: a pre-image from the descriptor alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic

import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import TypeVar

from ..hog.descriptor import hog
from ..hog.inputs import ArrayImage, Descriptors, descriptor_tensor, image_batch, to_array
from ..hog.spec import HOGSpec
from ..optimize import Minimiser, StopReason
from .histograms import recover_histograms, searchable
from .objective import squared_norm
from .parameterize import low_pass
from .polarity import fix_polarity
from .priors import Prior, Range, RelativeSmoothness
from .quality import QualityName, quality_of
from .search import Basis, PreimageSearch
from .start import NOISE, at_contrast, in_pairs, noise, starting_images

SHARE_OF_SAMPLES = 0.7  # of the evaluations, the rest goes to the descriptor itself
LEAST_EVALUATIONS = 28  # of a sample: fewer evaluations make fewer samples
RANGE_WEIGHT = 100.0  # of mean squares of gray values
SPREAD = 0.3  # standard deviation, in 0…1, of the noise the samples begin with, to differ in all that is left open
ENOUGH = 90  # evaluations of a sample, to explain so much away: with fewer it begins with less
SMOOTHING = 0.9  # pixels: what the samples agree on is coarser
MEMORY = 2**29  # bytes that the searches of a part of a batch take, about
VECTORS = 32  # of unknowns that a search of one image holds at most: measured, memory and images and all copies
TAILS = 0.005  # share of pixels that may be clipped at either end when the image is brought to 0…1

Values = TypeVar("Values", Tensor, NDArray[Any], default=Tensor)


@dataclass(frozen=True)
class Reconstruction(Generic[Values]):
    """Pre-images of a batch of descriptors: tensors, or arrays if the descriptors were arrays.

    Arrays of images have no channel axis: (B, H, W); those of a single descriptor (rows, cols, channels) have no batch
    axis either.

    Attributes:
        image: (B, 1, H, W) in 0…1.
        distance: (B,), ‖φ(image) - descriptor‖ / ‖descriptor‖, of exactly this image.
        stop_reason: why the search for each image ended; a sentence where no minimiser ended it.
        history: (evaluations, B), the relative distance of the image evaluated last, after each evaluation; a search
            that has ended repeats its last.
        evaluations: (B,), operator evaluations spent on each image, one forward and backward; a product of the Jacobian
            or its transpose with a vector is half of one.
        seconds: wall time for the whole batch.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(torch.rand(2, 1, 16, 16), spec)
    >>> result = nablahog.reconstruct(descriptor, spec, max_evaluations=10)
    >>> result.distance.shape, len(result.stop_reason), bool((result.evaluations <= 10).all())
    (torch.Size([2]), 2, True)
    """

    image: Values
    distance: Values
    stop_reason: list[StopReason] | list[str]
    history: Values
    evaluations: Values
    seconds: float


def to_unit_range(image: Tensor, spec: HOGSpec) -> Tensor:
    """Bring images (B, 1, H, W) of arbitrary brightness to 0…1.

    HOG fixes no brightness, and except for Eq. 7 as printed no contrast.  An image whose contrast is known keeps it
    and is shifted, its range centred on 0.5; any other is stretched so that 0.5 % of its pixels fall on 0 and 0.5 % on
    1.  What still exceeds 0…1 is clipped.
    """
    pixels = image.flatten(1)
    clipped = round(TAILS * (pixels.shape[1] - 1))
    low, high = (
        pixels.kthvalue(k, dim=1).values.reshape(-1, 1, 1, 1) for k in (1 + clipped, pixels.shape[1] - clipped)
    )
    if spec.normalizer.fixes_contrast:
        return (image - (low + high) / 2 + 0.5).clamp(0, 1)
    spread = high - low
    return torch.where(spread > 0, (image - low) / torch.where(spread > 0, spread, 1), 0.5).clamp(0, 1)


def descriptors_as_tensor(descriptor: Tensor | NDArray[Any]) -> Tensor:
    """Descriptors (B, rows, cols, channels), of an array (rows, cols, channels) one.

    Raises:
        TypeError: it is neither a tensor nor an array.
    """
    if isinstance(descriptor, Tensor):
        return descriptor
    tensor = descriptor_tensor("the descriptor", descriptor)
    return tensor[None] if tensor.dim() == 3 else tensor


def of_the_kind(result: Reconstruction, descriptor: Descriptors) -> Reconstruction[Descriptors]:
    """``result`` as arrays, if ``descriptor`` is one, and without the batch axis, if it has none."""
    if isinstance(descriptor, Tensor):
        return result
    single = descriptor.ndim == 3
    return Reconstruction(
        to_array(result.image[:, 0], single),
        to_array(result.distance, single),
        result.stop_reason,
        to_array(result.history[:, 0] if single else result.history),
        to_array(result.evaluations, single),
        result.seconds,
    )


def reconstruct(
    descriptor: Descriptors,
    spec: HOGSpec,
    image_size: tuple[int, int] | None = None,
    *,
    quality: QualityName = "best",
    seed: int = 0,
    max_evaluations: int | None = None,
    samples: int | None = None,
    closeness: float | None = None,
    start: Tensor | ArrayImage | None = None,
    expected: Tensor | ArrayImage | None = None,
    region_signs: bool = True,
    polarity: bool = True,
    smoothness: float = 0.02,
    prior: Prior | Sequence[Prior] = (),
    basis: Basis = "cosine",
    minimiser: Minimiser = "lbfgs",
    progress: Callable[[int, int], None] | None = None,
) -> Reconstruction[Descriptors]:
    """Images whose HOG is the given descriptor, from the descriptor alone, for a whole batch at once.

    The histograms before normalisation are recovered (:mod:`.histograms`); several images with these histograms are
    found from different starts, the samples; their mean, smoothed, is what the image is expected to be, since what
    they disagree on is made up; and from there, close to it, an image with this descriptor.  Of an unsigned
    descriptor, whose samples would differ in the signs of whole regions, what is expected comes from :mod:`.signs`;
    and of the image found and its negative, the one that looks more like a photograph is returned (:mod:`.polarity`).

    Each image has its own steps and its own stop, so a batch finds what its images alone would find, up to rounding,
    which a long search may amplify.  A batch that needs more than half a GiB (:data:`MEMORY`) is searched in parts, one
    after the other.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, a tensor on any device or a NumPy array; an array
            also (rows, cols, channels).
        spec: the dialect that made it.
        image_size: (height, width); by default whole cells, rows · cell height and cols · cell width.
        quality: ``"best"``, or ``"fast"``: an eighth of the evaluations, for a coarser image.
        seed: of the noise that the search starts from.  The same for every image of the batch.
        max_evaluations: operator evaluations an image may spend, at least 2, instead of the quality's: 660 where
            several samples are drawn, else 480, or 80.
        samples: instead of the quality's 4 or 2, at least 1, of a signed descriptor, or where a ``start`` is given;
            fewer are drawn if each could spend less than 28 evaluations.  A single one is where the descriptor itself
            is matched from, and nothing is expected.
        closeness: λ of :class:`.objective.PreimageObjective`, how strongly the image is kept at what is expected; by
            default 1 for signed specs, 0.1 for unsigned ones, whose region signs are uncertain.
        start: (B, 1, H, W) in 0…1, images to begin with, of any contrast; by default what the votes integrate to.
        expected: (B, 1, H, W) in 0…1, of any contrast, instead of the samples' mean; no samples are drawn.
        smoothness: ξ of Eq. 9, on the distance's own scale (see :func:`.priors.smoothness`).
        prior: one or several, added to the above; with ``smoothness=0``, instead of it.
        region_signs: whether an unsigned descriptor's regions get signs first.  If not, the search begins with noise,
            and nothing is expected.
        polarity: whether, of an unsigned descriptor's image and its negative, the likelier is returned.  If not, it is
            the one that was found.
        basis: the unknowns, ``"cosine"`` or, as in the paper, ``"pixels"``.
        minimiser: ``"lbfgs"``, ``"dogleg"`` (the paper's), ``"momentum"`` or ``"adam"``.
        progress: called with the evaluations done and the most there can be, over all parts of the batch.

    Raises:
        TypeError: the descriptor, ``start`` or ``expected`` is no floating-point tensor or array.
        ValueError: their shape contradicts spec and image size, they hold NaN or Inf, the spec keeps DPM's texture
            without directed channels, or an option is out of range.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), spec)
    >>> nablahog.reconstruct(descriptor, spec, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    >>> nablahog.reconstruct(descriptor[0].numpy(), spec, (32, 32), max_evaluations=10).image.shape  # an array
    (32, 32)
    """
    began = time.perf_counter()
    targets = descriptors_as_tensor(descriptor)
    height, width = check_descriptor(targets, spec, image_size)
    dialect, spec = spec, searchable(spec)
    rooted = dialect.gamma == "sqrt"
    first_image = _checked("start", start, targets, (height, width), rooted)
    expected_image = _checked("expected", expected, targets, (height, width), rooted)
    effort = quality_of(quality)
    if samples is None:
        samples = effort.samples
    sampling = expected_image is None and samples > 1 and (spec.signed or first_image is not None)
    if max_evaluations is None:
        max_evaluations = effort.evaluations if sampling else effort.without_samples
    check_budget(max_evaluations)
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")
    if closeness is None:
        closeness = 1.0 if spec.signed else 0.1
    for name, number in (("smoothness", smoothness), ("closeness", closeness)):
        if not 0 <= number < float("inf"):
            raise ValueError(f"{name} must be a finite number of at least 0, got {number}")
    priors: list[Prior] = [RelativeSmoothness(smoothness)] if smoothness else []
    if spec.normalizer.fixes_contrast:
        priors.append(Range(RANGE_WEIGHT))
    priors += [prior] if isinstance(prior, Prior) else prior
    targets = targets.detach()
    at_once = max(1, MEMORY // ((samples if sampling else 1) * VECTORS * height * width * targets.element_size()))
    parts = [slice(first, first + at_once) for first in range(0, len(targets), at_once)]
    searches, images = [], []
    for number, part in enumerate(parts):
        begins, expects = (None if given is None else given[part] for given in (first_image, expected_image))
        report = None if progress is None else _over_parts(progress, number, len(parts))
        search = PreimageSearch(targets[part], spec, (height, width), priors, basis, minimiser, max_evaluations, report)
        votes = recover_histograms(search.descriptor, spec, (height, width), max_evaluations=effort.on_histograms)
        if expects is None and begins is None and not spec.signed:
            if region_signs:
                expects = starting_images(votes, spec, height, width, 1, seed)[:, 0]
            else:
                begins = 0.5 + noise(votes, height, width, 1, seed)[:, 0].expand(len(votes), -1, -1, -1)
        images.append(_found(search, votes, begins, expects, samples if sampling else 1, closeness, seed))
        searches.append(search)
    image = to_unit_range(torch.cat(images), spec)
    if polarity and not spec.signed:
        image = fix_polarity(image)
    if rooted:
        image = image.square()
    length = max(len(search.history()) for search in searches)
    result = Reconstruction(
        image,
        relative_distance(image, targets, dialect),
        [reason for search in searches for reason in search.stop_reason],
        torch.cat([search.history(length) for search in searches], dim=1),
        torch.cat([search.evaluations for search in searches]),
        time.perf_counter() - began,
    )
    return of_the_kind(result, descriptor)


def _found(
    search: PreimageSearch,
    votes: Tensor,
    start: Tensor | None,
    expected: Tensor | None,
    samples: int,
    closeness: float,
    seed: int,
) -> Tensor:
    """Images (B, 1, H, W) that have the descriptors, of any contrast: first the samples, unless one is expected."""
    spec, (height, width) = search.spec, search.size
    if expected is None:
        on_samples = max(1, min(search.max_evaluations - 1, round(SHARE_OF_SAMPLES * search.max_evaluations)))
        count = max(1, min(samples, on_samples // LEAST_EVALUATIONS))
        spread = NOISE if count == 1 else SPREAD * min(1, on_samples // count / ENOUGH)
        if start is None:
            starts = starting_images(votes, spec, height, width, count, seed, spread)
        else:
            grain = in_pairs(votes, height, width, count, seed, spread)
            starts = at_contrast(start, votes, spec).unsqueeze(1) + grain
        found = search.match(starts, votes, on_samples // count)
        start = found.mean(dim=1)
        if count > 1:
            start = expected = low_pass(start, SMOOTHING)
    else:
        expected = at_contrast(expected, votes, spec)
        start = expected if start is None else at_contrast(start, votes, spec)
        constant = (start == start[..., :1, :1]).flatten(1).all(dim=1)
        if constant.any():  # there all derivatives vanish, and no search would leave it
            grainy = start + noise(votes, height, width, 1, seed)[:, 0]
            start = torch.where(constant.reshape(-1, 1, 1, 1), grainy, start)
    return search.match(start.unsqueeze(1), None, search.left(), expected, closeness)[:, 0]


def _over_parts(progress: Callable[[int, int], None], number: int, count: int) -> Callable[[int, int], None]:
    """``progress`` over ``count`` parts of a batch, told of the one called ``number``."""
    return lambda done, most: progress(number * most + done, count * most)


@torch.no_grad()
def relative_distance(image: Tensor, descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """‖φ(image) - descriptor‖ / ‖descriptor‖ of images (B, 1, H, W) and descriptors (B, rows, cols, channels): (B,)."""
    residual: Tensor = (hog(image, spec) - descriptor).flatten(1).norm(dim=1)
    return residual / squared_norm(descriptor).sqrt()


def check_budget(max_evaluations: int) -> None:
    """Raises ValueError unless an image may be searched with so many evaluations."""
    if max_evaluations < 2:
        raise ValueError(f"max_evaluations must be at least 2, one for each objective, got {max_evaluations}")


def _checked(
    name: str, images: Tensor | ArrayImage | None, descriptor: Tensor, size: tuple[int, int], rooted: bool
) -> Tensor | None:
    """``images``, or their roots, in the descriptor's dtype and on its device, once they are known to be usable."""
    if images is None:
        return None
    if not isinstance(images, Tensor):
        images, _ = image_batch(name, images)
        images = images / 255 if images.dtype == torch.uint8 else images
    if not images.is_floating_point():
        raise TypeError(f"{name} must be floating-point, got {images.dtype}")
    if images.shape != (len(descriptor), 1, *size):
        raise ValueError(f"{name} must have shape {(len(descriptor), 1, *size)}, got {tuple(images.shape)}")
    if not torch.isfinite(images).all():
        raise ValueError(f"{name} must be finite, got NaN or Inf")
    images = images.detach().to(descriptor)
    return images.clamp(min=0).sqrt() if rooted else images


def check_descriptor(descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int] | None) -> tuple[int, int]:
    """Height and width of the image to find, once descriptor, spec and image size agree.

    Raises:
        TypeError, ValueError: as :func:`reconstruct`.
    """
    if not isinstance(descriptor, Tensor) or descriptor.dtype not in (torch.float32, torch.float64):
        got = descriptor.dtype if isinstance(descriptor, Tensor) else type(descriptor).__name__
        raise TypeError(f"the descriptor must be a float32 or float64 tensor, got {got}")
    if descriptor.dim() != 4 or not len(descriptor):
        raise ValueError(
            f"the descriptor must have shape (B, rows, cols, channels), B at least 1, got {tuple(descriptor.shape)}"
        )
    rows, cols, channels = descriptor.shape[1:]
    height, width = image_size or spec.image_size(rows, cols)
    expected = (*spec.grid(height, width), spec.channels)
    if (rows, cols, channels) != expected:
        raise ValueError(
            f"{spec.named} descriptor of an image of {height}x{width} pixels must have shape "
            f"{expected} (rows, cols, channels), got {(rows, cols, channels)}"
        )
    if not torch.isfinite(descriptor).all():
        raise ValueError("the descriptor must be finite, got NaN or Inf")
    return height, width
