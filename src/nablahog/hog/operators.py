"""Steps of engines as operators of ``torch.library``, for graphs of ``torch.compile`` and ``torch.export``.

Their dialect is a string, its JSON, and has one colour.  They are differentiable once, in reverse mode.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

from .engine import Step, make_step, real_dtype
from .kernels.loops import NATIVE_ENGINE
from .spec import HOGSpec


@lru_cache(maxsize=64)
def _parse_spec(text: str) -> HOGSpec:
    """The dialect of an operator's string."""
    spec = HOGSpec.from_json(text)
    if spec.colours > 1:
        raise ValueError(f"an operator takes a dialect of one colour, got {spec.named} with colour 'separate'")
    return spec


def _step(name: str, images: Tensor, text: str) -> Step:
    """On a CPU or a GPU: a graph may be loaded where nothing has asked for Triton yet."""
    engine = NATIVE_ENGINE
    if images.is_cuda:
        from .triton.steps import EXPORTED_ENGINE as engine
    return make_step(getattr(engine, name), _parse_spec(text), images.shape[1:], images.dtype, real_dtype(images.dtype))


def _operator(name: str, shape: Callable[[HOGSpec, int, int], tuple[int, ...]]) -> Any:
    """``nablahog::name`` of images (B, C, H, W), to (B, …) of the shape, and ``nablahog::name_vjp``, its derivative."""

    @torch.library.custom_op(f"nablahog::{name}", mutates_args=())
    def run(images: Tensor, spec: str) -> Tensor:
        return _step(name, images, spec).run(images.detach())[0]

    @torch.library.custom_op(f"nablahog::{name}_vjp", mutates_args=())
    def vjp(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
        step, images = _step(name, images, spec), images.detach()
        return step.vjp(images, step.run(images)[1], grad_output.detach())

    @run.register_fake
    def _(images: Tensor, spec: str) -> Tensor:
        size = images.shape[0], *shape(_parse_spec(spec), *images.shape[2:])
        return images.new_empty(size, dtype=real_dtype(images.dtype))

    @vjp.register_fake
    def _(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
        return images.new_empty(images.shape)

    # ``ctx`` and operators are torch's own objects, without types
    def save(ctx: Any, inputs: tuple[Tensor, str], output: Tensor) -> None:
        x, ctx.spec = inputs
        ctx.save_for_backward(x)

    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return vjp(*ctx.saved_tensors, grad_output, ctx.spec), None

    run.register_autograd(backward, setup_context=save)
    return run


cells = _operator("cells", lambda spec, height, width: (*spec.cells(height, width), spec.bins))
"""Eq. 1-6: images (B, C, H, W) and a dialect to cells (B, rows, cols, bins)."""
describe = _operator("describe", lambda spec, height, width: (*spec.grid(height, width), spec.channels))
"""Images (B, C, H, W) and a dialect to descriptors (B, rows, cols, channels)."""
