"""Shapes and orders in which libraries return descriptors, and what their channels are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from torch import Tensor

from ..inputs.arrays import Descriptors, as_descriptors, to_array
from ..inputs.numbers import as_size
from ..inputs.tensors import check_dense
from .dialects import as_spec
from .orientation import bin_angles
from .spec import COLOURS, HOGSpec

TOKEN_CELLS = 2  # cells of the side of a transformer's patch


class _Arrangement(NamedTuple):
    """How a layout arises from (rows, cols, channels), without B."""

    sizes: tuple[int, ...]  # of the axes into which rows, columns and channels are split
    order: tuple[int, ...]  # of these axes in the layout
    shape: tuple[int, ...]  # of the layout, in which some of them are one


def _arrangement(spec: HOGSpec, rows: int, cols: int) -> _Arrangement:
    channels = spec.channels
    if spec.layout == "cells":
        return _Arrangement((rows, cols, channels), (0, 1, 2), (rows, cols, channels))
    if spec.layout == "planes":
        return _Arrangement((rows, cols, channels), (2, 0, 1), (channels, rows, cols))
    if spec.layout == "colour-planes":
        bins = channels // COLOURS
        return _Arrangement((rows, cols, COLOURS, bins), (2, 3, 0, 1), (COLOURS, bins, rows, cols))
    if spec.layout == "tokens":
        if rows % TOKEN_CELLS or cols % TOKEN_CELLS:
            raise ValueError(f"the layout 'tokens' needs even numbers of rows and columns of cells, got {rows}x{cols}")
        sizes = rows // TOKEN_CELLS, TOKEN_CELLS, cols // TOKEN_CELLS, TOKEN_CELLS, channels
        return _Arrangement(sizes, (0, 2, 4, 1, 3), (rows * cols // TOKEN_CELLS**2, channels * TOKEN_CELLS**2))
    assert spec.normalizer.layout_block is not None  # HOGSpec has checked it
    sizes = rows, cols, *spec.normalizer.layout_block, spec.bins
    order = (1, 0, 3, 2, 4) if spec.layout == "opencv-vector" else (0, 1, 2, 3, 4)
    return _Arrangement(sizes, order, sizes if spec.layout == "blocks" else (rows * cols * channels,))


def native_shape(spec: HOGSpec, image_size: tuple[int, int]) -> tuple[int, ...]:
    """The library's own shape of the descriptor of an image of (height, width) pixels.

    Raises:
        ValueError: the image is smaller than a cell, or in the layout of tokens has no whole number of these.
    """
    return _arrangement(spec, *spec.grid(*image_size)).shape


def to_layout(descriptor: Descriptors, spec: HOGSpec | str) -> Descriptors:
    """Converts descriptors (B, rows, cols, channels) to the spec's layout; arrays also (rows, cols, channels).

    By ``spec.layout`` this is ``"cells"``, the same; ``"planes"``, (B, channels, rows, cols); ``"colour-planes"``,
    (B, 3, bins, rows, cols); ``"tokens"``, (B, patches of 2x2 cells, channels · 4), those of a transformer, and in
    each channel by channel; ``"blocks"``, (B, rows, cols, rows of cells, columns of cells, bins); ``"block-vector"``,
    the same in one row; ``"opencv-vector"``, in one row, too, but column by column of blocks, and in a block column by
    column of cells.  The spec may be the name of a preset with its defaults.

    Args:
        descriptor: (B, rows, cols, channels), a tensor, or an array, which may lack B.
        spec: the dialect, or the name of a preset with its defaults.

    Returns:
        The descriptor in the shape above, of the same kind and dtype.  Entries are moved, not changed, so the result is
        differentiable.

    Raises:
        ValueError: the shape is none of the spec's; in the layout of tokens, rows or columns are odd; there is no such
            preset.

    >>> spec = nablahog.presets.opencv(win_size=(64, 128))
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 128, 64), spec)
    >>> descriptor.shape, nablahog.to_layout(descriptor, spec).shape
    (torch.Size([1, 15, 7, 36]), torch.Size([1, 3780]))
    """
    spec = as_spec(spec)
    if not isinstance(descriptor, Tensor):
        tensor, single = as_descriptors("the descriptor", descriptor)
        return to_array(to_layout(tensor, spec), single)
    check_dense("the descriptor", descriptor)
    if descriptor.dim() != 4 or descriptor.shape[3] != spec.channels:
        raise ValueError(
            f"{spec.named} descriptor must have shape (B, rows, cols, {spec.channels}), got {tuple(descriptor.shape)}"
            + (": write descriptor[None]" if descriptor.shape[2:] == (spec.channels,) else "")
        )
    sizes, order, shape = _arrangement(spec, *descriptor.shape[1:3])
    split = descriptor.reshape(len(descriptor), *sizes)
    return split.permute(0, *(1 + axis for axis in order)).reshape(len(descriptor), *shape)


def from_layout(native: Descriptors, spec: HOGSpec | str, image_size: tuple[int, int]) -> Descriptors:
    """The inverse of :func:`to_layout`: descriptors (B, rows, cols, channels).

    Args:
        native: B in front of the library's own shape, or of its entries in one row; an array also without B.
        spec: the dialect, or the name of a preset with its defaults.
        image_size: (height, width) of the images.

    Returns:
        (B, rows, cols, channels), of the kind and dtype of ``native``; differentiable.

    Raises:
        ValueError: the spec has no descriptor of that shape for images of that size; there is no such preset.

    >>> spec = nablahog.presets.opencv(win_size=(64, 128))
    >>> vector = np.zeros(3780, np.float32)  # as of cv2.HOGDescriptor().compute
    >>> nablahog.from_layout(vector, spec, (128, 64)).shape
    (15, 7, 36)
    """
    spec = as_spec(spec)
    image_size = as_size("image_size", image_size)
    rows, cols = spec.grid(*image_size)
    sizes, order, expected = _arrangement(spec, rows, cols)
    if not isinstance(native, Tensor):
        tensor, _ = as_descriptors("the descriptor", native)
        single = tuple(native.shape) in (expected, (math.prod(expected),))
        return to_array(from_layout(tensor.reshape(1, *native.shape) if single else tensor, spec, image_size), single)
    check_dense("the descriptor", native)
    shapes = (expected, (math.prod(expected),))
    if tuple(native.shape[1:]) not in shapes:
        raise ValueError(
            f"{spec.named} descriptor of an image of {image_size[0]}x{image_size[1]} pixels (height x width) has the "
            f"shape (B, {', '.join(map(str, expected))}), got {tuple(native.shape)}"
            + _advise_on_shape(tuple(native.shape), shapes)
        )
    split = native.reshape(len(native), *(sizes[axis] for axis in order))
    return split.permute(0, *(1 + order.index(axis) for axis in range(len(order)))).reshape(
        len(native), rows, cols, spec.channels
    )


def _advise_on_shape(shape: tuple[int, ...], shapes: Sequence[tuple[int, ...]]) -> str:
    if shape in shapes:
        return ": write descriptor[None]"
    if shape[-1:] == (math.prod(shapes[0]) + 1,):
        return ": the last is the bias of a detector, write descriptor[..., :-1]"
    return "; nablahog.which_hog says which parameters and sizes fit"


def channel_names(spec: HOGSpec | str) -> tuple[str, ...]:
    """Names of the channels of a descriptor, for readers, in the order of channels.

    Orientations are directions of gradients in degrees, from +x towards +y, down.

    Args:
        spec: the dialect, or the name of a preset with its defaults.

    Raises:
        ValueError: there is no such preset.

    >>> from nablahog.hog.layout import channel_names
    >>> names = channel_names("uoctti")
    >>> names[0], names[18], names[27]
    ('directed: 0°', 'undirected: 0°', 'texture: block up-left')
    """
    spec = as_spec(spec)
    bins = [f"{round(math.degrees(angle) % (360 if spec.signed else 180), 1):g}°" for angle in bin_angles(spec)]
    names = spec.normalizer.channel_names(bins, bins[: spec.bins // 2 if spec.signed else spec.bins])
    colours = [""] if spec.colours == 1 else ["red, ", "green, ", "blue, "]
    return tuple(f"{colour}{name}" for colour in colours for name in names)
