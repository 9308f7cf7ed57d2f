"""``skimage.feature.hog`` of scikit-image 0.26, for arrays, and for tensors with a derivative."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from skimage.draw import line
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.gradient import gradient
from ..hog.layout import to_layout
from ..hog.normalizers import BlockForm
from ..hog.orientation import magnitude
from ..hog.steps import normalize_reference

Image = TypeVar("Image", NDArray[Any], Tensor)


def hog(
    image: Image,
    orientations: int = 9,
    pixels_per_cell: Sequence[int] = (8, 8),
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
    also by rounding errors; a gradient less than 1.4e-14° below 0° votes nowhere, as there.  There are two differences:
    votes of a cell are added in float64 instead of float32, which changes entries by about 1e-7; and fewer than three
    orientations are refused.

    Args:
        image: (M, N), or with channels on ``channel_axis``; an array, or a tensor on any device.
        orientations: bins over 180°, at least 3.
        pixels_per_cell: (height, width).
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
        ``visualize``, also the image (M, N).  Arrays if ``image`` is one, else tensors on its device, differentiable in
        ``image``; float32 for images of float32 or less, otherwise float64.

    Raises:
        ValueError: the image has not two dimensions beside its channels, holds no block, or is complex; or an argument
            is out of its range.

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
    is_tensor = isinstance(image, Tensor)
    spec = presets.skimage(
        operator.index(orientations),
        _pair(pixels_per_cell),
        _pair(cells_per_block),
        block_norm,
        transform_sqrt=transform_sqrt and is_tensor,  # arrays take NumPy's square root
        feature_vector=feature_vector,
        value_range=1.0,
    )
    values = _tensor(image) if isinstance(image, Tensor) else torch.from_numpy(_array(image, transform_sqrt))
    planes = _planes(values, channel_axis)
    size = planes.shape[1], planes.shape[2]
    spec.grid(*size)
    cells = _cells(planes, spec)
    descriptor = to_layout(normalize_reference(cells.unsqueeze(0), spec).permute(0, 2, 3, 1), spec)[0]
    tensors = [descriptor.to(values.dtype).contiguous()]
    if visualize:
        tensors.append(_glyphs(cells, spec.cell_size, size, values.dtype))
    results: list[Any] = tensors if is_tensor else [each.numpy() for each in tensors]
    return (results[0], results[1]) if visualize else results[0]


def _pair(sizes: Sequence[int]) -> tuple[int, int]:
    """Two integers, also of NumPy, in a tuple or a list."""
    first, second = sizes
    return operator.index(first), operator.index(second)


def _array(image: NDArray[Any], transform_sqrt: bool) -> NDArray[Any]:
    """A copy of the image, of at least two dimensions, in float32 or float64."""
    image = np.atleast_2d(image)
    if image.dtype.kind == "c":
        raise ValueError(f"the image must be real, got {image.dtype}")
    values = image.astype(np.float32 if image.dtype.char in "ef" else np.float64, order="C")
    return np.sqrt(values) if transform_sqrt else values


def _tensor(image: Tensor) -> Tensor:
    """The image in float32 or float64, of at least two dimensions; not copied if it is so already."""
    image = torch.atleast_2d(image)  # type: ignore[no-untyped-call]
    if image.is_complex():
        raise ValueError(f"the image must be real, got {image.dtype}")
    return image.to(torch.float32 if image.is_floating_point() and image.dtype != torch.float64 else torch.float64)


def _planes(values: Tensor, channel_axis: int | None) -> Tensor:
    """The image's channels (C, M, N)."""
    if values.dim() != (2 if channel_axis is None else 3):
        raise ValueError(
            f"the image must have two dimensions, and a third for channels if channel_axis says which, got the shape "
            f"{tuple(values.shape)} and channel_axis {channel_axis}"
        )
    return values.unsqueeze(0) if channel_axis is None else values.movedim(channel_axis, 0)


def _cells(planes: Tensor, spec: HOGSpec) -> Tensor:
    """Mean votes (bins, rows, cols) of the cells, float64.  A NaN affects its cell only."""
    gx, gy = gradient(planes.unsqueeze(1), spec)
    along_x, along_y = (g.detach().cpu().numpy() for g in (gx, gy))
    if len(planes) > 1:
        winner = np.hypot(along_x, along_y).argmax(axis=0, keepdims=True)
        along_x, along_y = (np.take_along_axis(g, winner, axis=0) for g in (along_x, along_y))
        gx, gy = (g.gather(0, torch.from_numpy(winner).to(g.device)) for g in (gx, gy))
    outside = torch.from_numpy(_outside(along_x, along_y, spec.bins)).to(gx.device)
    votes = torch.where(outside, 0.0, magnitude(gx.double(), gy.double()))
    (rows, cols), (high, wide) = spec.cells(*planes.shape[1:]), spec.cell_size
    whole = votes[:, : rows * high, : cols * wide]
    return whole.reshape(spec.bins, rows, high, cols, wide).mean(dim=(2, 4))


def _outside(gx: NDArray[Any], gy: NDArray[Any], bins: int) -> NDArray[np.bool_]:
    """Whether gradients (1, M, N) lie outside each bin: (bins, M, N)."""
    angle = np.rad2deg(np.arctan2(gy.astype(np.float64), gx.astype(np.float64))) % 180
    begins = (180.0 / bins * np.arange(bins + 1)).reshape(-1, 1, 1)
    return (angle < begins[:-1]) | (angle >= begins[1:])


def _glyphs(cells: Tensor, cell_size: tuple[int, int], size: tuple[int, int], dtype: torch.dtype) -> Tensor:
    """Draws a line in each cell for each bin, at right angles to its gradients; lines that meet add up.

    Args:
        cells: (bins, rows, cols), the brightness of the lines.
        cell_size: (height, width) in pixels.
        size: (height, width) of the image.
        dtype: of the image, and of the sums.

    Returns:
        The image, on the device of ``cells``; differentiable, linear in them.

    Raises:
        ValueError: cells are one pixel wide, and a line leaves the image.
    """
    pixels, entries = (torch.from_numpy(index).to(cells.device) for index in _strokes(cells.shape, cell_size, size[1]))
    image = torch.zeros(size[0] * size[1], dtype=dtype, device=cells.device)
    return image.index_add(0, pixels, cells.flatten()[entries].to(dtype)).reshape(size)


def _strokes(
    shape: tuple[int, ...], cell_size: tuple[int, int], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels of a flat image, and the entry of flat cells to add to each."""
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
        if left.min() < 0:
            raise ValueError(f"{bins} lines leave the picture in cells of one pixel's width; use wider cells")
        rise, run = np.trunc(y + down[k]).astype(int) - top, np.trunc(x - right[k]).astype(int) - left
        for dy in np.unique(rise):
            for dx in np.unique(run):
                below, beside = line(0, 0, dy, dx)  # type: ignore[no-untyped-call]
                of_rows, of_cols = rise == dy, run == dx
                start = top[of_rows, None] * width + left[of_cols]
                stroke = start[..., None] + (below * width + beside)
                pixels.append(stroke.ravel())
                drawn.append(np.broadcast_to(entries[k][np.ix_(of_rows, of_cols)][..., None], stroke.shape).ravel())
    return np.concatenate(pixels), np.concatenate(drawn)
