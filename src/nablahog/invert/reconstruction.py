"""The results of a reconstruction: the final images, and those shown while it runs."""

from __future__ import annotations

import base64
import html
import io
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog.descriptor import hog
from ..hog.spec import HOGSpec
from ..inputs.arrays import Descriptors, to_array
from ..optimize import History, StopReason
from .polarity import looks_negative

TAIL_SHARE = 0.005  # share of pixels that may be clipped at either end when the image is brought to 0…1
SHOWN_IMAGES = 4  # images of a batch, in a notebook and with their distances

if TYPE_CHECKING:  # checkers know the package, which need not be installed: `typing` has defaults from Python 3.13 on
    import typing_extensions

    Values = typing_extensions.TypeVar("Values", Tensor, NDArray[Any], default=Tensor)
else:
    Values = TypeVar("Values", Tensor, NDArray[Any])


@dataclass(frozen=True, repr=False)
class Reconstruction(Generic[Values]):
    """Pre-images of a batch of descriptors: tensors, or arrays if the descriptors were arrays.

    Arrays of images have no channel axis: (B, H, W); those of a single descriptor (rows, cols, channels) have no batch
    axis either.

    Attributes:
        image: (B, 1, H, W) in 0…1.
        distance: (B,), ‖φ(image) - descriptor‖ / ‖descriptor‖, of exactly this image; ‖φ(image)‖ of a descriptor of
            zeros.
        stop_reason: why the search for each image ended; a sentence where no minimiser ended it.
        history: (evaluations, B), the relative distance of the image evaluated last, after each evaluation; a search
            that has ended repeats its last value.
        evaluations: (B,), operator evaluations spent on each image, one value with its gradient; a product of the
            Jacobian or its transpose with a vector is half of one.
        seconds: wall time for the whole batch.
        iterates: (iterations + 1, B, 1, H, W) in 0…1, the image after each iteration, from the start on; None unless
            :class:`.arguments.AsPublished` asks for them.
        polarity_confidence: (B,) in 0…1, probability that the image as a whole is not a negative, by a learned prior
            for unsigned descriptors; None without one.  At most 0.88 by the package's.  Single regions may be negatives
            all the same.
        region_confidence: (B, 1, H, W) in 0…1, probability that the region around a pixel, which a Gaussian of 8 pixels
            sees, is rightly brighter or darker than the image's mean, by the same prior; below 0.5 the opposite is
            likelier.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(torch.rand(2, 1, 16, 16), spec)
    >>> result = nablahog.reconstruct(descriptor, spec, quality="fast")
    >>> result.distance.shape, len(result.stop_reason), bool((result.evaluations <= 80).all())
    (torch.Size([2]), 2, True)
    """

    image: Values
    distance: Values
    stop_reason: list[StopReason] | list[str]
    history: Values
    evaluations: Values
    seconds: float
    iterates: Values | None = None
    polarity_confidence: Values | None = None
    region_confidence: Values | None = None

    def __repr__(self) -> str:
        """Shape and figures, not the pixels."""
        distances = [f"{distance:.3g}" for distance in self.distance.reshape(-1)[:SHOWN_IMAGES].tolist()]
        more = ", …" if len(self.stop_reason) > SHOWN_IMAGES else ""
        return (
            f"<Reconstruction image {'x'.join(map(str, self.image.shape))}, distance {', '.join(distances)}{more}, "
            f"{', '.join(dict.fromkeys(map(str, self.stop_reason)))}, {self.seconds:.1f} s>"
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the image in the format of the name's ending: PNG, JPEG, TIFF or another of Pillow's, 8 bits.

        Of several images each gets its number: ``"preimage.png"`` becomes ``preimage_0.png``, ``preimage_1.png`` and so
        on.  Files are replaced whole.

        Raises:
            ValueError: there is no such format.
            OSError: a file cannot be written.
        """
        from ..io.images import write_image

        path, images = Path(os.fsdecode(path)), self.image.reshape(-1, *self.image.shape[-2:])
        for number, image in enumerate(images):
            write_image(path if len(images) == 1 else path.with_stem(f"{path.stem}_{number}"), image)

    def _repr_html_(self) -> str:
        """The first images, for notebooks."""
        from ..io.images import to_pil

        height, width = self.image.shape[-2:]
        pictures = []
        for image in self.image.reshape(-1, height, width)[:SHOWN_IMAGES]:
            file = io.BytesIO()
            to_pil(image).save(file, format="PNG")
            png = base64.b64encode(file.getvalue()).decode("ascii")
            pictures.append(
                f'<img src="data:image/png;base64,{png}" width="{width}" height="{height}" alt="pre-image">'
            )
        return f"<p>{' '.join(pictures)}</p><p>{html.escape(repr(self))}</p>"


def squared_norm(x: Tensor) -> Tensor:
    """‖x‖² of each row of a batch (B, …)."""
    return x.square().flatten(1).sum(1)


def squared_scale(x: Tensor) -> Tensor:
    """‖x‖² of each row of a batch (B, …), to divide by: 1 where x is 0, from which no distance is relative."""
    size = squared_norm(x)
    return size.masked_fill(size < torch.finfo(x.dtype).tiny, 1)


def to_unit_range(image: Tensor, spec: HOGSpec) -> Tensor:
    """Brings images (B, 1, H, W) of arbitrary brightness to 0…1.

    HOG fixes no brightness, and except for Eq. 7 as printed no contrast of strong edges.  An image whose contrast is
    known keeps it and is shifted, its range centred on 0.5; any other is stretched so that 0.5 % of its pixels fall on
    0 and 0.5 % on 1.  The rest is clipped.
    """
    pixels = image.flatten(1)
    clipped = round(TAIL_SHARE * (pixels.shape[1] - 1))
    low, high = (
        pixels.kthvalue(k, dim=1).values.reshape(-1, 1, 1, 1) for k in (1 + clipped, pixels.shape[1] - clipped)
    )
    if spec.normalizer.fixes_contrast:
        return (image - (low + high) / 2 + 0.5).clamp(0, 1)
    spread = high - low
    return torch.where(spread > 0, (image - low) / torch.where(spread > 0, spread, 1), 0.5).clamp(0, 1)


def to_gray_values(image: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) in 0…1, of images of arbitrary brightness, or of their square roots if φ describes these."""
    image = to_unit_range(image, spec)
    return image.square() if spec.gamma == "sqrt" else image


def find_negatives(image: Tensor, confidence: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
    """Which images (B, 1, H, W) in 0…1 are probably negatives, (B,), and the confidence (B,) after negating these.

    A learned prior's ``confidence`` decides, the probability that an image is not a negative; without one,
    :mod:`.polarity` does.
    """
    if confidence is None:
        return looks_negative(image), None
    return confidence < 0.5, torch.maximum(confidence, 1 - confidence)


def negate(values: Tensor, which: Tensor) -> Tensor:
    """Images or confidences (B, …) in 0…1, with those in the mask ``which`` (B,) replaced by their negatives."""
    return torch.where(which.reshape(-1, *[1] * (values.ndim - 1)), 1 - values, values)


@torch.no_grad()
def relative_distance(image: Tensor, descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """‖φ(image) - descriptor‖ / ‖descriptor‖ of images (B, 1, H, W) and descriptors (B, rows, cols, channels): (B,)."""
    residual: Tensor = (hog(image, spec) - descriptor).flatten(1).norm(dim=1)
    return residual / squared_scale(descriptor).sqrt()


def convert_like(result: Reconstruction, descriptor: Descriptors) -> Reconstruction[Descriptors]:
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
        None if result.iterates is None else to_array(result.iterates[:, 0, 0] if single else result.iterates[:, :, 0]),
        None if result.polarity_confidence is None else to_array(result.polarity_confidence, single),
        None if result.region_confidence is None else to_array(result.region_confidence[:, 0], single),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Iterate:
    """The images that a search evaluated last, for a part of a batch.

    Attributes:
        descriptors: the indices of the part.
        evaluations: (b,), operator evaluations spent on each so far.
        distance: (b,), ‖φ(image) - descriptor‖ / ‖descriptor‖; of several samples for a descriptor, the mean of theirs.
        candidates: (b, K, 1, H, W), the samples for each, or its one image; of any brightness and contrast.  They are
            overwritten by the next evaluation.
        spec: the dialect.
    """

    descriptors: slice
    evaluations: Tensor
    distance: Tensor
    candidates: Tensor
    spec: HOGSpec

    @property
    def image(self) -> Tensor:
        """(b, 1, H, W) in 0…1, a copy; the mean of several samples."""
        return to_gray_values(self.candidates.mean(dim=1), self.spec)


Watch: TypeAlias = Callable[[Iterate], None]
"""Called after each round of evaluations; an exception that it raises ends the search."""


class SearchRecord:
    """Evaluations (B,), distances and reasons to stop of the search of a part of a batch."""

    def __init__(self, descriptor: Tensor, dialect: HOGSpec, watch: Watch | None, part: slice) -> None:
        self.descriptor, self.dialect, self.watch, self.part = descriptor, dialect, watch, part
        self.evaluations = torch.zeros(len(descriptor), dtype=torch.long, device=descriptor.device)
        self.history = History(len(descriptor))
        self.stop_reason: list[StopReason] = []

    def show_first(self, images: Tensor) -> None:
        """Shows images (B, 1, H, W) before the search; square roots if the dialect describes these."""
        if self.watch is not None:
            distance = relative_distance(to_gray_values(images, self.dialect), self.descriptor, self.dialect)
            self.show(distance, images.unsqueeze(1))

    def show(self, distance: Tensor, candidates: Tensor) -> None:
        if self.watch is not None:
            self.watch(Iterate(self.part, self.evaluations, distance, candidates, self.dialect))


def build_reconstruction(
    image: Tensor, descriptor: Tensor, spec: HOGSpec, searches: Sequence[SearchRecord], began: float
) -> Reconstruction:
    """The result of the searches of all parts, for images (B, 1, H, W) in 0…1; they ``began`` at that time."""
    length = max(int(search.evaluations.max()) for search in searches)
    return Reconstruction(
        image,
        relative_distance(image, descriptor, spec),
        [reason for search in searches for reason in search.stop_reason],
        torch.cat([search.history.fill(length) for search in searches], dim=1),
        torch.cat([search.evaluations for search in searches]),
        seconds=time.perf_counter() - began,
    )


def split_batch(
    count: int, at_once: int, progress: Callable[[int, int], None] | None
) -> Iterator[tuple[slice, Callable[[int, int], None] | None]]:
    """A batch in parts of at most ``at_once``, each with its share of ``progress``."""
    number = -(-count // at_once)
    for k in range(number):
        yield slice(k * at_once, (k + 1) * at_once), scale_progress(progress, k, number)


def scale_progress(
    progress: Callable[[int, int], None] | None, number: int, count: int
) -> Callable[[int, int], None] | None:
    """``progress`` over ``count`` equal parts of a reconstruction, to be called by the part ``number``."""
    return None if progress is None else lambda done, most: progress(number * most + done, count * most)
