"""The engines' steps as operators of ``torch.library``, for graphs of ``torch.compile`` and ``torch.export``.

Their dialect is a string, its JSON.  They are differentiable once, in reverse mode.
"""

from __future__ import annotations

from collections.abc import Callable
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


def _operator(name: str, shape: Callable[[HOGSpec, int, int], tuple[int, ...]]) -> Any:
    """``nablahog::name`` of images (B, C, H, W), to (B, …) of the shape, and ``nablahog::name_vjp``, its derivative."""

    @torch.library.custom_op(f"nablahog::{name}", mutates_args=())
    def run(images: Tensor, spec: str) -> Tensor:
        output: Tensor = getattr(_engine(images), name)(images.detach(), _spec_of(spec))
        return output.contiguous()

    @torch.library.custom_op(f"nablahog::{name}_vjp", mutates_args=())
    def vjp(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
        grad: Tensor = getattr(_engine(images), f"{name}_vjp")(images.detach(), grad_output.detach(), _spec_of(spec))
        return grad

    @run.register_fake
    def _(images: Tensor, spec: str) -> Tensor:
        dtype = torch.get_default_dtype() if images.dtype == torch.uint8 else images.dtype
        real = torch.float32 if dtype in (torch.float16, torch.bfloat16) else dtype  # which kernels of a GPU read
        return images.new_empty(images.shape[0], *shape(_spec_of(spec), *images.shape[2:]), dtype=real)

    @vjp.register_fake
    def _(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
        dtype = images.dtype if images.is_floating_point() else torch.get_default_dtype()
        return images.new_empty(images.shape, dtype=dtype)

    # ``ctx`` and operators are torch's own objects, without types
    def save(ctx: Any, inputs: tuple[Tensor, str], output: Tensor) -> None:
        x, ctx.spec = inputs
        ctx.save_for_backward(x)

    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return vjp(*ctx.saved_tensors, grad_output, ctx.spec), None

    run.register_autograd(backward, setup_context=save)
    return run


cells = _operator("cells", lambda spec, height, width: (*spec.cells(height, width), spec.colours * spec.bins))
"""Eq. 1-6: images (B, C, H, W) and a dialect to cells (B, rows, cols, colours · bins)."""
describe = _operator("describe", lambda spec, height, width: (*spec.grid(height, width), spec.channels))
"""Images (B, C, H, W) and a dialect to descriptors (B, rows, cols, channels)."""
