"""``skimage.feature.hog`` of scikit-image 0.26, for arrays, and for tensors with a derivative."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any, Literal, TypeVar, overload

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.gradient import gradient
from ..hog.normalizers.block import BlockForm
from ..hog.orientation import magnitude
from ..inputs.arrays import as_array, to_array
from ..inputs.numbers import as_integer, as_plain, as_size, shortened
from ..inputs.tensors import check_dense, read_tensor
from ..runtime.extras import extra

__all__ = ["hog"]

MOST_ORIENTATIONS = 2**16
_TRACEABLE = "nablahog.hog(images, 'skimage'), images (B, C, H, W)"  # for torch.vmap and torch.export

Image = TypeVar("Image", NDArray[Any], Tensor)


@overload
def hog(
    image: Image,
    orientations: int = 9,
    pixels_per_cell: Sequence[float] = (8, 8),
    cells_per_block: Sequence[int] = (3, 3),
    block_norm: BlockForm = "L2-Hys",
    visualize: Literal[False] = False,
    transform_sqrt: bool = False,
    feature_vector: bool = True,
    *,
    channel_axis: int | None = None,
) -> Image: ...
@overload
def hog(
    image: Image,
    orientations: int = 9,
    pixels_per_cell: Sequence[float] = (8, 8),
    cells_per_block: Sequence[int] = (3, 3),
    block_norm: BlockForm = "L2-Hys",
    *,
    visualize: Literal[True],
    transform_sqrt: bool = False,
    feature_vector: bool = True,
    channel_axis: int | None = None,
) -> tuple[Image, Image]: ...
@overload
def hog(
    image: Image,
    orientations: int = 9,
    pixels_per_cell: Sequence[float] = (8, 8),
    cells_per_block: Sequence[int] = (3, 3),
    block_norm: BlockForm = "L2-Hys",
    visualize: bool = False,
    transform_sqrt: bool = False,
    feature_vector: bool = True,
    *,
    channel_axis: int | None = None,
) -> Image | tuple[Image, Image]: ...
def hog(
    image: Image,
    orientations: int = 9,
    pixels_per_cell: Sequence[float] = (8, 8),
    cells_per_block: Sequence[int] = (3, 3),
    block_norm: BlockForm = "L2-Hys",
    visualize: bool = False,
    transform_sqrt: bool = False,
    feature_vector: bool = True,
    *,
    channel_axis: int | None = None,
) -> Image | tuple[Image, Image]:
    """``skimage.feature.hog``: the same result for the same arguments.

    Values are not rescaled, and ε is absolute.  Ties between two bins or two channels are decided as in scikit-image,
    also by rounding errors; a gradient less than 1.4e-14° below 0° votes nowhere, as there.  One difference is left:
    votes of a cell are added in float64 instead of float32, which changes entries by about 1e-7.  Cells whose sides are
    not whole numbers, and 0 bins or cells in a block, are errors; scikit-image then returns an empty or another
    descriptor.

    Votes are hard, so the descriptor jumps where a gradient crosses the border of two orientation bins.  The derivative
    does not see the jump: it is that of the magnitude in the bin that gets the vote, 0 in the others.  To optimise, use
    linear votes, ``nablahog.presets.skimage(…).with_linear_votes()``, another descriptor.

    Args:
        image: (M, N), or with channels on ``channel_axis``; an array or what becomes one, or a tensor on any device.
            Fill a masked array first, ``image.filled(0)``: as in scikit-image, the difference of two pixels of which
            one is masked is the pixel on the right or below.
        orientations: bins over 180°, at least 1.
        pixels_per_cell: (height, width), whole numbers, also as floats.
        cells_per_block: (rows, cols).
        block_norm: ``"L1"``, ``"L1-sqrt"``, ``"L2"`` or ``"L2-Hys"``.
        visualize: whether to return an image of the HOG, too: in each cell a line for each bin, along the edges that
            vote for it, as bright as the bin's mean vote.
        transform_sqrt: whether the square root of the image is taken first.  Of a negative value it is NaN in an array,
            with NumPy's warning, and 0 in a tensor.
        feature_vector: whether the descriptor is flattened.
        channel_axis: None for gray images; otherwise each pixel votes with the channel of the largest gradient.

    Returns:
        The descriptor, (rows of blocks, columns of blocks, rows of cells, columns of cells, bins), or flat; with
        ``visualize``, also the image (M, N).  Tensors on its device if ``image`` is one, differentiable in it, else
        arrays; float32 for images of float32 or less, otherwise float64.

    Raises:
        ValueError: the image has not two dimensions beside its channels, holds no block, or is complex; or an argument
            is out of its range, or bins or an axis are not integers.
        TypeError: the image holds no numbers; or a number of cells or pixels is not a whole one.
        numpy.exceptions.AxisError: the image has no such ``channel_axis``.

    Source: ``skimage/feature/_hog.py``.

    >>> import torch
    >>> from nablahog.compat.skimage import hog
    >>> image = torch.linspace(0, 1, 64 * 64).reshape(64, 64).requires_grad_()
    >>> descriptor = hog(image, cells_per_block=(2, 2), feature_vector=False)
    >>> descriptor.shape
    torch.Size([7, 7, 2, 2, 9])
    >>> descriptor.sum().backward()
    >>> image.grad.shape
    torch.Size([64, 64])
    """
    bins = as_integer("orientations", orientations, 1, MOST_ORIENTATIONS)
    cell = _as_pair("pixels_per_cell", pixels_per_cell, may_be_floats=True)
    block = _as_pair("cells_per_block", cells_per_block)
    # its bins do not count: other dialects have no fewer than three
    spec = presets.skimage(
        pixels_per_cell=cell,
        cells_per_block=block,
        block_norm=block_norm,
        transform_sqrt=transform_sqrt and isinstance(image, Tensor),  # arrays take NumPy's square root
        value_range=1.0,
    )
    if isinstance(image, np.ndarray | Tensor) and "complex" in str(image.dtype):
        raise ValueError(f"the image must be real, got {image.dtype}: write image.real")
    values = _tensor(image) if isinstance(image, Tensor) else _array(image, transform_sqrt)
    planes = _planes(values, channel_axis)
    size = planes.shape[1], planes.shape[2]
    least = block[0] * cell[0], block[1] * cell[1]
    if size[0] < least[0] or size[1] < least[1]:  # in the words of scikit-image
        raise ValueError(
            "The input image is too small given the values of pixels_per_cell and cells_per_block. "
            f"It should have at least: {least[0]} rows and {least[1]} cols."
        )
    gx, gy = _gradient(planes, spec)
    cells = _cells(gx, gy, bins, spec)
    blocks = spec.normalizer.normalize(cells.unsqueeze(0), signed=False)[0].permute(1, 2, 0)
    descriptor = blocks.flatten() if feature_vector else blocks.reshape(*blocks.shape[:2], block[0], block[1], bins)
    tensors = [descriptor.to(gx.dtype).contiguous()]
    if visualize:
        tensors.append(_glyphs(cells, cell, size, gx.dtype))
    results: list[Any] = tensors if isinstance(image, Tensor) else [to_array(tensor) for tensor in tensors]
    return (results[0], results[1]) if visualize else results[0]


def _as_pair(name: str, sides: object, *, may_be_floats: bool = False) -> tuple[int, int]:
    """Two integers of whatever Python unpacks; a TypeError if one of two is not whole, as in scikit-image."""
    is_iterated = isinstance(sides, Iterable) and not hasattr(sides, "tolist")
    plain = as_plain(tuple(islice(sides, 3)) if is_iterated else sides)  # type: ignore[call-overload]
    if isinstance(plain, tuple) and may_be_floats:
        plain = tuple(int(side) if isinstance(side, float) and side.is_integer() else side for side in plain)
    if not isinstance(plain, tuple) or (len(plain) == 2 and not all(type(side) is int for side in plain)):
        raise TypeError(f"{name} must be two whole numbers, of rows and columns, got {shortened(sides)}")
    return as_size(name, plain, "rows, columns")


def _array(image: object, transform_sqrt: bool) -> NDArray[Any]:
    """A copy of the image, of at least two dimensions, in float32 or float64.  Masked arrays remain such."""
    values = np.atleast_2d(image if isinstance(image, np.ma.MaskedArray) else as_array("image", image))
    values = values.astype(np.float32 if values.dtype.char in "ef" else np.float64, order="C")
    return np.sqrt(values) if transform_sqrt else values


def _tensor(image: Tensor) -> Tensor:
    """The image in float32 or float64, of at least two dimensions; not copied if it is so already."""
    check_dense("image", image)
    image = torch.atleast_2d(image)  # type: ignore[no-untyped-call]
    return image.to(torch.float32 if image.is_floating_point() and image.dtype != torch.float64 else torch.float64)


def _planes(values: Image, channel_axis: object) -> Image:
    """The image's channels (C, M, N)."""
    axis = as_plain(channel_axis)
    if isinstance(axis, tuple) and len(axis) == 1:
        (axis,) = axis
    if type(axis) is int and not -values.ndim <= axis < values.ndim:
        raise np.exceptions.AxisError(axis, values.ndim, "channel_axis")
    if axis is not None:
        axis = as_integer("channel_axis", axis, -values.ndim, values.ndim - 1)
    if values.ndim != (2 if axis is None else 3):  # in the words of scikit-image
        raise ValueError(
            "Only images with two spatial dimensions are supported. If using with color/multichannel images, specify "
            f"`channel_axis`: got the shape {tuple(values.shape)} and channel_axis {axis}"
        )
    if axis is None:
        return values[None]
    if not values.shape[axis]:
        raise ValueError(f"the image must have at least one channel, got the shape {tuple(values.shape)}")
    return values.movedim(axis, 0) if isinstance(values, Tensor) else np.moveaxis(values, axis, 0)


def _gradient(planes: NDArray[Any] | Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Gx, Gy (C, M, N) of an image's channels."""
    if isinstance(planes, np.ma.MaskedArray):  # takes the values that NumPy leaves where a difference is masked
        gx, gy = np.zeros((2, *planes.shape), planes.dtype)
        gx[:, :, 1:-1] = planes[:, :, 2:] - planes[:, :, :-2]
        gy[:, 1:-1] = planes[:, 2:] - planes[:, :-2]
        return torch.from_numpy(gx), torch.from_numpy(gy)
    values = planes if isinstance(planes, Tensor) else torch.from_numpy(planes)
    return gradient(values.unsqueeze(1), spec)


def _cells(gx: Tensor, gy: Tensor, bins: int, spec: HOGSpec) -> Tensor:
    """Mean votes (bins, rows, cols) of the cells, float64, by the gradients (C, M, N).  A NaN affects its cell only."""
    along_x, along_y = (read_tensor("image", g, _TRACEABLE) for g in (gx, gy))
    if len(gx) > 1:
        winner = np.hypot(along_x, along_y).argmax(axis=0, keepdims=True)
        along_x, along_y = (np.take_along_axis(g, winner, axis=0) for g in (along_x, along_y))
        gx, gy = (g.gather(0, torch.from_numpy(winner).to(g.device)) for g in (gx, gy))
    outside = torch.from_numpy(_outside(along_x, along_y, bins)).to(gx.device)
    votes = torch.where(outside, 0.0, magnitude(gx.double(), gy.double()))
    (rows, cols), (high, wide) = spec.cells(*gx.shape[1:]), spec.cell_size
    whole = votes[:, : rows * high, : cols * wide]
    return whole.reshape(bins, rows, high, cols, wide).mean(dim=(2, 4))


def _outside(gx: NDArray[Any], gy: NDArray[Any], bins: int) -> NDArray[np.bool_]:
    """Whether gradients (1, M, N) lie outside each bin: (bins, M, N)."""
    angle = np.rad2deg(np.arctan2(gy.astype(np.float64), gx.astype(np.float64))) % 180
    begins = (180.0 / bins * np.arange(bins + 1)).reshape(-1, 1, 1)
    return (angle < begins[:-1]) | (angle >= begins[1:])


def _glyphs(cells: Tensor, cell_size: tuple[int, int], size: tuple[int, int], dtype: torch.dtype) -> Tensor:
    """An image of a line in each cell for each bin, as bright as ``cells`` (bins, rows, cols); lines that meet add up.

    Lines are at right angles to the gradients of their bins.  The image is linear in ``cells``, and differentiable.
    """
    pixels, entries = (torch.from_numpy(index).to(cells.device) for index in _strokes(cells.shape, cell_size, size[1]))
    image = torch.zeros(size[0] * size[1], dtype=dtype, device=cells.device)
    return image.index_add(0, pixels, cells.flatten()[entries].to(dtype)).reshape(size)


def _strokes(
    shape: tuple[int, ...], cell_size: tuple[int, int], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels of a flat image, and the entry of flat cells to add to each."""
    with extra("skimage", "visualize=True"):
        from skimage.draw import line

    bins, rows, cols = shape
    radius = min(cell_size) // 2 - 1
    angles = np.pi * (np.arange(bins) + 0.5) / bins
    down, right = radius * np.cos(angles), radius * np.sin(angles)
    y, x = (np.arange(n) * side + side // 2 for n, side in zip((rows, cols), cell_size, strict=True))
    entries = np.arange(bins * rows * cols).reshape(shape)
    pixels, drawn = [], []
    for k in range(bins):
        # the absolute ends are truncated, not those relative to the cell's centre: cells may differ by rounding
        top, left = np.trunc(y - down[k]).astype(int), np.trunc(x + right[k]).astype(int)
        bottom, end = np.trunc(y + down[k]).astype(int), np.trunc(x - right[k]).astype(int)
        if end.max() >= width:
            raise ValueError(f"lines of {bins} orientations leave the picture in cells of one pixel; use larger cells")
        rise, run = bottom - top, end - left
        for dy in np.unique(rise):
            for dx in np.unique(run):
                below, beside = line(0, 0, dy, dx)  # type: ignore[no-untyped-call]
                of_rows, of_cols = rise == dy, run == dx
                start = top[of_rows, None] * width + left[of_cols]
                stroke = start[..., None] + (below * width + beside)
                pixels.append(stroke.ravel())
                drawn.append(np.broadcast_to(entries[k][np.ix_(of_rows, of_cols)][..., None], stroke.shape).ravel())
    return np.concatenate(pixels), np.concatenate(drawn)


def __dir__() -> list[str]:
    return __all__
