"""Learning the background of exemplar LDA from photographs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..hog.descriptor import histograms, normalize
from ..hog.dialects import as_spec
from ..hog.gradient import gray
from ..hog.presets import aubry
from ..hog.spec import HOGSpec
from ..inputs.arrays import ArrayImage
from ..inputs.numbers import as_integer
from ..inputs.training_images import digest_of_images, gray_photographs
from ..io.checkpoint import Checkpoint
from ..io.images import SAMPLE_NAMES, limit_size, sample_photograph
from ..runtime.pytorch import in_plain_mode
from .whitening import Background, check_spec

STORED_BACKGROUNDS = Path(__file__).with_name("default_backgrounds")  # see its README.md
SCALE_STEP = 2**-0.5  # between two scales of a photograph
SAVED = 10  # images between two checkpoints
ORDER = 9  # the largest offset in cells of a background: for templates of up to 10x10
RING_CELLS = 1  # cells next to the border of an image, which are unlike all others
COARSE_CELL, FINE_CELL = 8, 4  # pixels of a cell; the fine ones tell poses apart that are half as far from each other


def least_size(spec: HOGSpec, order: int = ORDER) -> tuple[int, int]:
    """(height, width) of the smallest image to learn from."""
    cells = order + 1 + 2 * RING_CELLS
    return spec.image_size(cells, cells)


@in_plain_mode
def learn_background(
    images: Mapping[str, Tensor | ArrayImage],
    spec: HOGSpec | str,
    *,
    order: int = ORDER,
    regularization: float = 0.01,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
    map_function: Callable[..., Iterable[Any]] = map,
) -> Background:
    """Mean and autocovariance of the descriptor over photographs and all their scales.

    Each image is shrunk by √2 until it is smaller than :func:`least_size`.  The averages are exact, over all cells and
    all pairs of cells at an offset, without the outermost cells.

    Args:
        images: (H, W) each, gray, in 0…1 or uint8, tensors, arrays or PIL images, by name; described in float32.
        spec: the dialect, or the name of a preset with its defaults; not globally normalised.
        order: the largest offset between cells, at least 0; templates may have one row and column more.
        regularization: see :class:`.whitening.Background`.
        checkpoint: a file that is written every 10 images.  If it exists and is of the same learning, this is resumed,
            with the same result.  The file is not removed.
        progress: called with the images done, their number and the name of the last one.
        map_function: as ``map``, of one argument: perhaps in other processes.

    Raises:
        TypeError: the images have no names, or one is no image of real numbers.
        ValueError: there are no images, or one is too small or holds other values; the spec is globally normalised;
            ``order`` is below 0; the checkpoint is damaged or of another learning.
        OSError: the checkpoint cannot be read or written.

    >>> photographs = {"a": torch.rand(96, 128), "b": torch.rand(128, 96)}
    >>> background = nablahog.pose.learn_background(photographs, "aubry", order=2)
    >>> background.mean.shape, background.order
    (torch.Size([9]), 2)
    """
    spec = as_spec(spec)
    check_spec(spec)
    order = as_integer("order", order, 0)
    photographs = gray_photographs(images, least_size(spec, order))
    names, sums = list(images), torch.zeros((), dtype=torch.float64)
    identity = {"images": digest_of_images(photographs), "names": names, "spec": spec.to_json(), "order": order}
    saved: dict[str, Any] = {"done": 0, "sums": sums}
    file = Checkpoint(checkpoint, identity)
    file.resume(saved.update)
    first_done, sums = saved["done"], saved["sums"]
    progress(first_done, len(names), "")
    rest = names[first_done:]
    image_sums = map_function(partial(_sum_scales, spec=spec, order=order), [photographs[name] for name in rest])
    for done, (name, sums_of_image) in enumerate(zip(rest, image_sums, strict=True), start=first_done + 1):
        sums = sums + sums_of_image
        if done % SAVED == 0:
            file.save({"done": done, "sums": sums})
        progress(done, len(names), name)
    # over all pairs of cells: sums of products, of the first, of the second, and the number of pairs
    products, first, second, pairs = sums[..., :-1, :-1], sums[..., :-1, -1:], sums[..., -1:, :-1], sums[..., -1:, -1:]
    mean = first[order, order, :, 0] / pairs[order, order, 0, 0]
    a, b = mean[:, None], mean[None, :]
    covariance = (products - b * first - a * second) / pairs + a * b
    covariance = (covariance + covariance.flip(0, 1).mT) / 2  # equal but for rounding
    return Background(spec, mean, covariance[order:].contiguous(), tuple(images), regularization)


def default_background(spec: HOGSpec | str, order: int = ORDER) -> Background:
    """The background of the photographs that come with scikit-image.

    Those of :func:`pose_spec` come with the package, any other is learned at its first call.

    Args:
        spec, order: as for :func:`learn_background`.

    Raises:
        ValueError: as :func:`learn_background`.
        ModuleNotFoundError: it must be learned, and scikit-image is not installed.

    >>> background = nablahog.pose.default_background(nablahog.presets.aubry(cell_size=8), 2)
    >>> background.mean.shape, background.order
    (torch.Size([9]), 2)
    """
    return _default_background(as_spec(spec), as_integer("order", order, 0))


@lru_cache(maxsize=8)
def _default_background(spec: HOGSpec, order: int) -> Background:
    file = STORED_BACKGROUNDS / f"cells_of_{spec.cell_size[0]}.npz"
    if order == ORDER and file.exists() and spec == pose_spec(spec.cell_size[0]):
        return Background.load(file)
    photographs = {name: gray(sample_photograph(name)[None])[0, 0] for name in SAMPLE_NAMES}
    return learn_background(photographs, spec, order=order)


@lru_cache(maxsize=4)
def pose_spec(cell_size: int = COARSE_CELL) -> HOGSpec:
    """The descriptor of poses by default: Aubry et al.'s nine contrast-insensitive channels, of gray images."""
    return aubry(cell_size, colour="gray")


def _pyramid(image: Tensor, spec: HOGSpec, order: int) -> Iterator[Tensor]:
    """Descriptors (C, rows, cols), float64, of an image (H, W) at all scales, without their outermost cells."""
    height, width = least_size(spec, order)
    scale, small = 1.0, image
    while small.shape[0] >= height and small.shape[1] >= width:
        cells = normalize(histograms(small[None, None], spec), spec)[0]
        yield cells[:, RING_CELLS:-RING_CELLS, RING_CELLS:-RING_CELLS].double()
        scale *= SCALE_STEP
        small = limit_size(image[None], max(1, round(scale * max(image.shape))))[0]


def _sum_scales(image: Tensor, *, spec: HOGSpec, order: int) -> Tensor:
    """The sums of :func:`_add_products` over all scales of an image, float64."""
    channels = spec.channels + 1
    sums = torch.zeros(2 * order + 1, 2 * order + 1, channels, channels, dtype=torch.float64)
    for cells in _pyramid(image, spec, order):
        _add_products(cells, sums)
    return sums


def _add_products(cells: Tensor, sums: Tensor) -> None:
    """Adds, for each offset (dy, dx) and channels a and b, Σ a(y, x) · b(y + dy, x + dx) over all pairs of cells.

    A further channel of ones gives the sums over pairs, and their number.

    Args:
        cells: (C, rows, cols).
        sums: (2 · order + 1, 2 · order + 1, C + 1, C + 1), changed in place; offset 0 is in the middle.
    """
    order = len(sums) // 2
    channels = torch.cat([cells, torch.ones_like(cells[:1])])
    padded = [n + order for n in cells.shape[1:]]  # by zeros, so that opposite sides do not meet
    spectra = torch.fft.rfft2(channels, s=padded)
    offsets = torch.arange(-order, order + 1)
    for a in range(len(channels)):
        products = torch.fft.irfft2(spectra[a].conj() * spectra[a:], s=padded)
        products = products[:, offsets][:, :, offsets].permute(1, 2, 0)
        sums[:, :, a, a:] += products
        sums[:, :, a + 1 :, a] += products.flip(0, 1)[..., 1:]
