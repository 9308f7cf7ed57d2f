"""The compiled steps as operators of ``torch.library``: what ``torch.compile`` and ``torch.export`` put in a graph.

They know a dialect by its JSON, and have derivatives in reverse mode.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

from ..spec import HOGSpec
from . import loops
from .colours import merge_colours, separate_colours, separate_colours_vjp, split_colours


@lru_cache(maxsize=64)
def _spec(text: str) -> HOGSpec:
    return HOGSpec.from_json(text)


@lru_cache(maxsize=64)
def _of_one_colour(text: str) -> HOGSpec:
    return _spec(text).of_one_colour()


def _empty(images: Tensor, *shape: int) -> Tensor:
    dtype = torch.get_default_dtype() if images.dtype == torch.uint8 else images.dtype
    return images.new_empty(images.shape[0], *shape, dtype=dtype)


@torch.library.custom_op("nablahog::cells", mutates_args=())
def cells(images: Tensor, spec: str) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, rows, cols, colours · bins)."""
    each = loops.cells(separate_colours(images.detach(), _spec(spec)), _of_one_colour(spec))
    return merge_colours(each, _spec(spec)).contiguous()


@torch.library.custom_op("nablahog::cells_vjp", mutates_args=())
def cells_vjp(images: Tensor, given: Tensor, spec: str) -> Tensor:
    """What reaches the images from what reaches the cells."""
    known, each = _spec(spec), separate_colours(images.detach(), _spec(spec))
    found = loops.cells_vjp(each, split_colours(given.detach(), known), _of_one_colour(spec))
    return separate_colours_vjp(found, images.shape[1], known).contiguous()


@torch.library.custom_op("nablahog::describe", mutates_args=())
def describe(images: Tensor, spec: str) -> Tensor:
    """Images (B, C, H, W) to descriptors (B, rows, cols, channels)."""
    one = _of_one_colour(spec)
    each = loops.describe(separate_colours(images.detach(), _spec(spec)), one)[0]
    return merge_colours(each, _spec(spec)).contiguous()


@torch.library.custom_op("nablahog::describe_vjp", mutates_args=())
def describe_vjp(images: Tensor, given: Tensor, spec: str) -> Tensor:
    """What reaches the images from what reaches the descriptors."""
    known, one, each = _spec(spec), _of_one_colour(spec), separate_colours(images.detach(), _spec(spec))
    found = loops.describe_vjp(each, loops.cells(each, one).numpy(), split_colours(given.detach(), known), one)
    return separate_colours_vjp(found, images.shape[1], known).contiguous()


@cells.register_fake
def _(images: Tensor, spec: str) -> Tensor:
    known = _spec(spec)
    return _empty(images, *known.cells(*images.shape[2:]), known.colours * known.bins)


@describe.register_fake
def _(images: Tensor, spec: str) -> Tensor:
    known = _spec(spec)
    return _empty(images, *known.grid(*images.shape[2:]), known.channels)


@cells_vjp.register_fake
@describe_vjp.register_fake
def _(images: Tensor, given: Tensor, spec: str) -> Tensor:
    return _empty(images, *images.shape[1:])


def _keep(ctx: Any, inputs: tuple[Tensor, str], output: Tensor) -> None:
    x, ctx.spec = inputs
    ctx.save_for_backward(x)


def _cells_backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
    return torch.ops.nablahog.cells_vjp(*ctx.saved_tensors, given, ctx.spec), None


def _describe_backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
    return torch.ops.nablahog.describe_vjp(*ctx.saved_tensors, given, ctx.spec), None


cells.register_autograd(_cells_backward, setup_context=_keep)
describe.register_autograd(_describe_backward, setup_context=_keep)
