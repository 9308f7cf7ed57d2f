"""``cv2.HOGDescriptor`` of OpenCV 4, without its detector."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.gradient import gradient
from ..hog.layout import to_layout
from ..hog.orientation import votes
from ..hog.pooling import pool
from ..hog.steps import normalize_reference

Size: TypeAlias = tuple[int, int]  # (width, height), as everywhere in OpenCV
_AT_ONCE = 2**23  # votes of all blocks that are pooled together: 32 MiB


@dataclass(frozen=True, init=False)
class HOGDescriptor:
    """``cv2.HOGDescriptor``, with its arguments and attributes; positions and sizes are (x, y).

    Descriptors are the same up to about 1e-6, float32 rounding, with one exception: on processors with SSE2 or NEON,
    OpenCV uses the ``L2HysThreshold`` of the first descriptor that a process computes for all later ones; here each
    object has its own.

    ``derivAperture``, ``histogramNormType`` and ``nlevels`` are stored, and as in OpenCV do not change a descriptor.

    Attributes:
        winSize: (width, height) of a window in pixels.
        blockSize: (width, height) of a block in pixels, whole cells.
        blockStride: pixels from one block to the next; divides the window less a block.
        cellSize: (width, height) of a cell in pixels.
        nbins: orientation bins over 180°, or over 360° if ``signedGradient``; at least 3.
        derivAperture: 1.
        winSigma: of the Gaussian over a block, pixels; a quarter of the mean of its sides if not above 0.
        histogramNormType: 0.
        L2HysThreshold: the clip.
        gammaCorrection: whether the square root of the image is taken first.  True in ``HOGDescriptor()``, else False
            by default.
        nlevels: of a pyramid.
        signedGradient: whether opposite gradients vote into different bins.
        spec: the dialect of one window, for :func:`nablahog.hog`, which is differentiable.

    Raises:
        TypeError: some of the first five arguments are missing, or not of OpenCV's types.
        ValueError: sizes do not suit each other, or an argument is out of its range.

    Source: ``modules/objdetect/src/hog.cpp`` of OpenCV 4.

    >>> import numpy as np
    >>> from nablahog.compat.opencv import HOGDescriptor
    >>> descriptor = HOGDescriptor()  # instead of cv2.HOGDescriptor()
    >>> descriptor.getDescriptorSize()
    3780
    >>> image = np.arange(136 * 72, dtype=np.uint8).reshape(136, 72)
    >>> descriptor.compute(image).shape  # 2 x 2 windows of 64x128 (width x height), 8 pixels apart
    (15120,)
    """

    winSize: Size
    blockSize: Size
    blockStride: Size
    cellSize: Size
    nbins: int
    derivAperture: int
    winSigma: float
    histogramNormType: int
    L2HysThreshold: float
    gammaCorrection: bool
    nlevels: int
    signedGradient: bool
    spec: HOGSpec = field(repr=False, compare=False)

    def __init__(
        self,
        _winSize: Sequence[int] | None = None,
        _blockSize: Sequence[int] | None = None,
        _blockStride: Sequence[int] | None = None,
        _cellSize: Sequence[int] | None = None,
        _nbins: int | None = None,
        _derivAperture: int = 1,
        _winSigma: float = -1,
        _histogramNormType: int = 0,
        _L2HysThreshold: float = 0.2,
        _gammaCorrection: bool | None = None,
        _nlevels: int = 64,
        _signedGradient: bool = False,
    ) -> None:
        if all(value is None for value in (_winSize, _blockSize, _blockStride, _cellSize, _nbins)):  # HOGDescriptor()
            _winSize, _blockSize, _blockStride, _cellSize, _nbins = (64, 128), (16, 16), (8, 8), (8, 8), 9
            _gammaCorrection = True
        window, block = _size("winSize", _winSize), _size("blockSize", _blockSize)
        stride, cell = _size("blockStride", _blockStride), _size("cellSize", _cellSize)
        if _nbins is None:
            raise TypeError("HOGDescriptor takes no argument, or at least the first five: there is no _nbins")
        bins = operator.index(_nbins)
        self.__dict__.update(  # frozen, as OpenCV's attributes are
            winSize=window,
            blockSize=block,
            blockStride=stride,
            cellSize=cell,
            nbins=bins,
            derivAperture=_derivAperture,
            winSigma=float(_winSigma),
            histogramNormType=_histogramNormType,
            L2HysThreshold=float(_L2HysThreshold),
            gammaCorrection=bool(_gammaCorrection),
            nlevels=_nlevels,
            signedGradient=bool(_signedGradient),
            spec=presets.opencv(
                window,
                block,
                stride,
                cell,
                bins,
                win_sigma=_winSigma if _winSigma > 0 else -1,
                l2hys_threshold=_L2HysThreshold,
                gamma=bool(_gammaCorrection),
                signed=bool(_signedGradient),
            ),
        )

    def getDescriptorSize(self) -> int:
        """Length of the descriptor of one window."""
        rows, cols = self._blocks_of_window()
        return rows * cols * self.spec.channels

    def compute(
        self,
        img: NDArray[np.uint8],
        winStride: Sequence[int] | None = None,
        padding: Sequence[int] | None = None,
        locations: Sequence[Sequence[int]] | NDArray[np.integer] | None = None,
    ) -> NDArray[np.float32]:
        """Descriptors of windows, one after another; not differentiable.

        Gradients are those of the whole image, padded by reflection at its outermost pixels (reflect-101).

        Args:
            img: (rows, cols), or (rows, cols, 1 or 3), uint8.
            winStride: pixels from one window to the next, the cell size if None or (0, 0).  Windows are in order row by
                row, from the upper left corner of the padded image.
            padding: pixels on each side of the image, 0 if negative.  It is rounded up to a multiple of the greatest
                common divisor of ``winStride`` and ``blockStride`` if that is a power of two, and otherwise to the
                number that OpenCV computes.
            locations: the upper left corners of windows, in pixels of the image, instead of a grid of windows.

        Returns:
            (windows * descriptor size,), float32.  Zeros for windows of ``locations`` beyond the padded image.

        Raises:
            TypeError: the image is no array of uint8, or an argument is not of integers.
            ValueError: the image is of another shape, or smaller, with its padding, than a window.
        """
        image = _image(img)
        step = self.cellSize if winStride is None else _size("winStride", winStride)
        step = self.cellSize if step == (0, 0) else step
        if min(step) < 1:
            raise ValueError(f"winStride must be at least 1 along both axes, got {step}")
        margins = (0, 0) if padding is None else _size("padding", padding)
        across, down = (
            _aligned(max(p, 0), math.gcd(s, b)) for p, s, b in zip(margins, step, self.blockStride, strict=True)
        )
        size = np.array([image.shape[2] + 2 * across, image.shape[1] + 2 * down])
        if locations is None or not len(locations):
            corners = self._grid(size, step)
        else:
            corners = _locations(locations) + np.array([across, down])
        inside = ((corners >= 0) & (corners <= size - self.winSize)).all(axis=1)
        descriptors = np.zeros((len(corners), self.getDescriptorSize()), np.float32)
        if inside.any():
            bordered = image[:, _reflected(image.shape[1], down)][..., _reflected(image.shape[2], across)]
            with torch.autocast("cpu", enabled=False):
                descriptors[inside] = self._windows(self._votes(bordered), corners[inside]).numpy()
        return descriptors.ravel()

    def _blocks_of_window(self) -> tuple[int, int]:
        """Rows and columns."""
        cols, rows = ((w - b) // s + 1 for w, b, s in zip(self.winSize, self.blockSize, self.blockStride, strict=True))
        return rows, cols

    def _grid(self, size: NDArray[np.int64], step: Size) -> NDArray[np.int64]:
        """Corners (windows, 2) of all windows, row by row."""
        if (size < self.winSize).any():
            raise ValueError(
                f"the image must hold a window of {self.winSize[0]}x{self.winSize[1]} pixels (width x height), got "
                f"{size[0]}x{size[1]} with its padding"
            )
        x, y = (np.arange(0, n - window + 1, s) for n, window, s in zip(size, self.winSize, step, strict=True))
        return np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=1)

    def _votes(self, planes: NDArray[np.uint8]) -> Tensor:
        """Votes (bins, H, W), float32, of an image (C, H + 2, W + 2) padded by one pixel."""
        gx, gy = gradient(torch.from_numpy(planes.astype(np.float32)).unsqueeze(1), self.spec)
        gx, gy = gx[:, 1:-1, 1:-1], gy[:, 1:-1, 1:-1]
        squared = gx * gx + gy * gy
        # of equal channels the first; in the last columns, which OpenCV's vector loop leaves over, the last
        first = squared.max(dim=0, keepdim=True).indices
        last = len(planes) - 1 - squared.flip(0).max(dim=0, keepdim=True).indices
        width = gx.shape[2]
        winner = torch.where(torch.arange(width, device=gx.device) < width // 4 * 4, first, last)
        return votes(gx.gather(0, winner), gy.gather(0, winner), self.spec)[0]

    def _windows(self, pixel_votes: Tensor, corners: NDArray[np.int64]) -> Tensor:
        """Descriptors (windows, entries) of windows with these corners; blocks in several windows are computed once."""
        rows, cols = self._blocks_of_window()
        (across, down), width = self.blockStride, pixel_votes.shape[2]
        x = corners[:, 0, None, None] + across * np.arange(cols)[:, None]  # column by column of blocks
        y = corners[:, 1, None, None] + down * np.arange(rows)
        places, block_of = np.unique((y * width + x).ravel(), return_inverse=True)
        wide, high = self.blockSize
        patches = pixel_votes.unfold(1, high, 1).unfold(2, wide, 1)
        blocks = []
        for some in torch.split(torch.from_numpy(places), max(1, _AT_ONCE // (self.nbins * high * wide))):
            histograms = pool(patches[:, some // width, some % width].transpose(0, 1), self.spec)
            blocks.append(to_layout(normalize_reference(histograms, self.spec).permute(0, 2, 3, 1), self.spec))
        return torch.cat(blocks)[torch.from_numpy(block_of.ravel())].reshape(len(corners), -1)


def _size(name: str, value: object) -> Size:
    """A pair (x, y) of integers."""
    try:
        across, down = map(operator.index, value)  # type: ignore[call-overload]
        return across, down
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a pair (width, height) of integers, got {value!r}") from None


def _image(img: Any) -> NDArray[np.uint8]:
    """The image's channels (C, rows, cols)."""
    if not isinstance(img, np.ndarray) or img.dtype != np.uint8:
        kind = img.dtype if isinstance(img, np.ndarray) else type(img).__name__
        raise TypeError(f"img must be an array of uint8, got {kind}")
    planes = img[None] if img.ndim == 2 else np.moveaxis(img, -1, 0)
    if planes.ndim != 3 or len(planes) not in (1, 3) or not planes.size:
        raise ValueError(f"img must have the shape (rows, cols), or 1 or 3 channels behind, got {img.shape}")
    return planes


def _locations(locations: Sequence[Sequence[int]] | NDArray[np.integer]) -> NDArray[np.int64]:
    corners = np.asarray(locations)
    if corners.dtype.kind not in "iu" or corners.ndim != 2 or corners.shape[1] != 2:
        raise TypeError(f"locations must be pairs (x, y) of integers, got {corners.dtype} of the shape {corners.shape}")
    return corners.astype(np.int64)


def _aligned(pixels: int, step: int) -> int:
    """OpenCV's ``alignSize``: rounds up to a multiple of ``step`` if that is a power of two."""
    return (pixels + step - 1) & -step


def _reflected(pixels: int, padding: int) -> NDArray[np.int64]:
    """Indices that pad an axis by reflection, with ``padding`` + 1 pixels on each side."""
    index = np.arange(-padding - 1, pixels + padding + 1) % max(2 * pixels - 2, 1)
    return np.minimum(index, np.maximum(2 * pixels - 2 - index, 0))
