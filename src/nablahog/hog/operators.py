"""The engines' steps as operators of ``torch.library``, for graphs of ``torch.compile`` and ``torch.export``.

Their dialect is a string, its JSON.  They are differentiable once, in reverse mode.
"""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from . import kernels
from .spec import HOGSpec


@lru_cache(maxsize=64)
def _spec_of(text: str) -> HOGSpec:
    """The dialect of an operator's string."""
    return HOGSpec.from_json(text)


def _engine(images: Tensor) -> ModuleType:
    """The loops of a CPU, or the kernels of a GPU: a graph may be loaded where nothing has asked for Triton yet."""
    if not images.is_cuda:
        return kernels
    from .triton import steps

    return steps


@torch.library.custom_op("nablahog::cells", mutates_args=())
def cells(images: Tensor, spec: str) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, rows, cols, colours · bins)."""
    each: Tensor = _engine(images).cells(images.detach(), _spec_of(spec))
    return each


@torch.library.custom_op("nablahog::cells_vjp", mutates_args=())
def cells_vjp(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    """Gradients with respect to the images from those with respect to the cells."""
    grad: Tensor = _engine(images).cells_vjp(images.detach(), grad_output.detach(), _spec_of(spec))
    return grad


@torch.library.custom_op("nablahog::describe", mutates_args=())
def describe(images: Tensor, spec: str) -> Tensor:
    """Images (B, C, H, W) to descriptors (B, rows, cols, channels)."""
    descriptors: Tensor = _engine(images).describe(images.detach(), _spec_of(spec))
    return descriptors.contiguous()


@torch.library.custom_op("nablahog::describe_vjp", mutates_args=())
def describe_vjp(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    """Gradients with respect to the images from those with respect to the descriptors."""
    grad: Tensor = _engine(images).describe_vjp(images.detach(), grad_output.detach(), _spec_of(spec))
    return grad


def _empty(images: Tensor, *shape: int) -> Tensor:
    dtype = torch.get_default_dtype() if images.dtype == torch.uint8 else images.dtype
    real = torch.float32 if dtype in (torch.float16, torch.bfloat16) else dtype  # which kernels of a GPU read
    return images.new_empty(images.shape[0], *shape, dtype=real)


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


# ``ctx`` and operators are torch's own objects, without types
def _save(ctx: Any, inputs: tuple[Tensor, str], output: Tensor) -> None:
    x, ctx.spec = inputs
    ctx.save_for_backward(x)


def _register_gradient(operator: Any, vjp: Any) -> None:
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return vjp(*ctx.saved_tensors, grad_output, ctx.spec), None

    operator.register_autograd(backward, setup_context=_save)


_register_gradient(cells, cells_vjp)
_register_gradient(describe, describe_vjp)
