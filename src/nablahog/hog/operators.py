"""The engines' steps as operators of ``torch.library``, for graphs of ``torch.compile`` and ``torch.export``.

Their dialect is a string, its JSON.  They are differentiable once, in reverse mode.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

from .colours import merge_colours, separate_colours, separate_colours_vjp, split_colours
from .kernels import loops
from .spec import HOGSpec


@lru_cache(maxsize=64)
def _spec_of(text: str) -> HOGSpec:
    """The dialect of an operator's string."""
    return HOGSpec.from_json(text)


@lru_cache(maxsize=64)
def _of_one_colour(text: str) -> HOGSpec:
    return _spec_of(text).of_one_colour()


def _empty(images: Tensor, *shape: int) -> Tensor:
    dtype = torch.get_default_dtype() if images.dtype == torch.uint8 else images.dtype
    real = torch.float32 if dtype in (torch.float16, torch.bfloat16) else dtype  # which kernels of a GPU read
    return images.new_empty(images.shape[0], *shape, dtype=real)


@torch.library.custom_op("nablahog::cells", mutates_args=())
def cells(images: Tensor, spec: str) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, rows, cols, colours · bins)."""
    each = loops.cells(separate_colours(images.detach(), _spec_of(spec)), _of_one_colour(spec))
    return merge_colours(each, _spec_of(spec)).contiguous()


@torch.library.custom_op("nablahog::cells_vjp", mutates_args=())
def cells_vjp(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    """Gradients with respect to the images from those with respect to the cells."""
    dialect, each = _spec_of(spec), separate_colours(images.detach(), _spec_of(spec))
    grad_images = loops.cells_vjp(each, split_colours(grad_output.detach(), dialect), _of_one_colour(spec))
    return separate_colours_vjp(grad_images, images.shape[1], dialect).contiguous()


@torch.library.custom_op("nablahog::describe", mutates_args=())
def describe(images: Tensor, spec: str) -> Tensor:
    """Images (B, C, H, W) to descriptors (B, rows, cols, channels)."""
    one = _of_one_colour(spec)
    each = loops.describe(separate_colours(images.detach(), _spec_of(spec)), one)[0]
    return merge_colours(each, _spec_of(spec)).contiguous()


@torch.library.custom_op("nablahog::describe_vjp", mutates_args=())
def describe_vjp(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    """Gradients with respect to the images from those with respect to the descriptors."""
    dialect, one, each = _spec_of(spec), _of_one_colour(spec), separate_colours(images.detach(), _spec_of(spec))
    cells = loops.cells(each, one)
    grad_images = loops.describe_vjp(each, cells, split_colours(grad_output.detach(), dialect), one)
    return separate_colours_vjp(grad_images, images.shape[1], dialect).contiguous()


@cells.register_fake
def _(images: Tensor, spec: str) -> Tensor:
    dialect = _spec_of(spec)
    return _empty(images, *dialect.cells(*images.shape[2:]), dialect.colours * dialect.bins)


@describe.register_fake
def _(images: Tensor, spec: str) -> Tensor:
    dialect = _spec_of(spec)
    return _empty(images, *dialect.grid(*images.shape[2:]), dialect.channels)


@cells_vjp.register_fake
@describe_vjp.register_fake
def _(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    dtype = images.dtype if images.is_floating_point() else torch.get_default_dtype()
    return images.new_empty(images.shape, dtype=dtype)


# ``ctx`` is torch's own object, without a type
def _save(ctx: Any, inputs: tuple[Tensor, str], output: Tensor) -> None:
    x, ctx.spec = inputs
    ctx.save_for_backward(x)


def _cells_backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
    return torch.ops.nablahog.cells_vjp(*ctx.saved_tensors, grad_output, ctx.spec), None


def _describe_backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
    return torch.ops.nablahog.describe_vjp(*ctx.saved_tensors, grad_output, ctx.spec), None


cells.register_autograd(_cells_backward, setup_context=_save)
describe.register_autograd(_describe_backward, setup_context=_save)


# on a GPU; a graph with these operators may be loaded where nothing has asked for Triton yet


@cells.register_kernel("cuda")
def _(images: Tensor, spec: str) -> Tensor:
    from .triton import steps

    return steps.cells(images.detach(), _spec_of(spec))


@cells_vjp.register_kernel("cuda")
def _(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    from .triton import steps

    return steps.cells_vjp(images.detach(), grad_output.detach(), _spec_of(spec))


@describe.register_kernel("cuda")
def _(images: Tensor, spec: str) -> Tensor:
    from .triton import steps

    return steps.describe(images.detach(), _spec_of(spec))


@describe_vjp.register_kernel("cuda")
def _(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    from .triton import steps

    with torch.enable_grad():
        x = images.detach().requires_grad_()
        return torch.autograd.grad(steps.describe(x, _spec_of(spec)), x, grad_output.detach())[0]
