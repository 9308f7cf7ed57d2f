"""The engines' steps as functions of PyTorch: differentiable in reverse and forward mode, and under ``vmap``.

Second derivatives are those of the reference steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import torch
from torch import Tensor
from torch.autograd import Function, forward_ad
from torch.nn import Parameter

from .spec import HOGSpec
from .steps import histograms_reference, normalize_reference

Both: TypeAlias = tuple[Tensor, Tensor]

# ``Any`` below is the type of what PyTorch passes to a Function untyped: ``ctx``, ``info`` and the inputs of ``vmap``


@dataclass(frozen=True)
class Step:
    """A step of an engine, its derivatives, and the same step in operations of PyTorch.

    ``run`` returns the output and a tensor (B, n) for the derivatives.  ``vjp`` maps the input, that tensor and the
    gradient of the output to the gradient of the input; ``jvp`` maps the input's tangent to the output's.
    """

    run: Callable[[Tensor, HOGSpec], tuple[Tensor, Tensor]]
    vjp: Callable[[Tensor, Tensor, Tensor, HOGSpec], Tensor]
    jvp: Callable[[Tensor, Tensor, Tensor, HOGSpec], Tensor]
    reference: Callable[[Tensor, HOGSpec], Tensor]


def _applied(function: type[Function], *inputs: Any) -> Any:
    return function.apply(*inputs)  # type: ignore[no-untyped-call]


def _first(x: Tensor, dim: int | None, size: int) -> Tensor:
    """Moves a mapped dimension to the front, or adds one."""
    return x.expand(size, *x.shape) if dim is None else x.movedim(dim, 0)


def jvp_by_vjp(function: Callable[..., Tensor], at: tuple[Tensor, ...], tangents: tuple[Tensor, ...]) -> Tensor:
    """The jvp as the vjp of the vjp: forward mode cannot be nested in itself."""
    value, vjp = torch.func.vjp(function, *at)[:2]
    tangent: Tensor = torch.func.vjp(vjp, torch.zeros_like(value))[1](tangents)[0]
    return tangent


_transforms_active: Callable[[], bool] = getattr(torch._C, "_are_functorch_transforms_active", lambda: True)


# whether a gradient is batched (``is_grads_batched`` of torch.autograd.grad): only PyTorch's own functions can read it
_batched: Callable[[Tensor], bool] = getattr(torch._C._functorch, "is_legacy_batchedtensor", lambda _: False)


def _no_transforms() -> bool:
    """Whether no transform of ``torch.func`` and no forward mode is active."""
    return not _transforms_active() and forward_ad._current_level < 0


def _vjp_of_reference(x: Tensor, grad_output: Tensor, step: Step, spec: HOGSpec) -> Tensor:
    with torch.enable_grad():
        x = x.detach().requires_grad_()
        return torch.autograd.grad(step.reference(x, spec), x, grad_output)[0]


class _Simple(Function):
    """:class:`_Run` where no transform is active: PyTorch's own overhead is a fifth."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, step: Step, spec: HOGSpec) -> Tensor:
        output, ctx.saved = step.run(x.detach(), spec)
        ctx.step, ctx.spec = step, spec
        ctx.save_for_backward(x)
        return output

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None, None]:
        (x,), saved = ctx.saved_tensors, ctx.saved
        if _batched(grad_output):
            return _vjp_of_reference(x, grad_output, ctx.step, ctx.spec), None, None
        if torch.is_grad_enabled() or not _no_transforms():
            return _applied(_Vjp, x, saved, grad_output, ctx.step, ctx.spec), None, None
        return ctx.step.vjp(x.detach(), saved, grad_output.resolve_neg(), ctx.spec), None, None


# the C++ function behind ``Function.apply``: unlike that, it does not check for transforms again
_simple: Callable[[Tensor, Step, HOGSpec], Tensor] = super(Function, _Simple).apply


class _Run(Function):
    @staticmethod
    def forward(x: Tensor, step: Step, spec: HOGSpec) -> Both:
        return step.run(x.detach(), spec)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, Step, HOGSpec], output: Both) -> None:
        x, ctx.step, ctx.spec = inputs
        ctx.mark_non_differentiable(output[1])
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(x, output[1])
        ctx.save_for_forward(x, output[1])

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor | None, _: Tensor | None) -> tuple[Tensor | None, None, None]:
        if grad_output is None:
            return None, None, None
        return _applied(_Vjp, *ctx.saved_tensors, grad_output, ctx.step, ctx.spec), None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor | None, *_: None) -> tuple[Tensor | None, None]:
        if tangent is None:
            return None, None
        return _applied(_Jvp, *ctx.saved_tensors, tangent, ctx.step, ctx.spec), None

    @staticmethod
    def vmap(info: Any, in_dims: Any, x: Tensor, step: Step, spec: HOGSpec) -> tuple[Both, tuple[int, int]]:
        mapped = x.movedim(in_dims[0], 0)
        output, saved = _applied(_Run, mapped.flatten(0, 1), step, spec)
        return (output.unflatten(0, mapped.shape[:2]), saved.unflatten(0, mapped.shape[:2])), (0, 0)


def _derivative(name: str, reference: Callable[[Step, HOGSpec], Callable[[Tensor, Tensor], Tensor]]) -> type[Function]:
    """The function of PyTorch for ``Step.vjp`` or ``Step.jvp``; ``reference`` computes the same by the reference step.

    It is linear in the last of its three tensors, ``direction``.
    """

    class Derivative(Function):
        @staticmethod
        def forward(x: Tensor, saved: Tensor, direction: Tensor, step: Step, spec: HOGSpec) -> Tensor:
            output: Tensor = getattr(step, name)(x.detach(), saved.detach(), direction.detach(), spec)
            return output

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple[Tensor, Tensor, Tensor, Step, HOGSpec], output: Tensor) -> None:
            x, _, direction, ctx.step, ctx.spec = inputs
            ctx.save_for_backward(x, direction)
            ctx.save_for_forward(x, direction)

        @staticmethod
        def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor | None, ...]:
            grad_x, grad_direction = torch.func.vjp(reference(ctx.step, ctx.spec), *ctx.saved_tensors)[1](grad_output)
            return grad_x, None, grad_direction, None, None

        @staticmethod
        def jvp(ctx: Any, tangent_x: Tensor | None, _: Tensor | None, tangent: Tensor | None, *__: None) -> Tensor:
            pairs = zip(ctx.saved_tensors, (tangent_x, tangent), strict=True)
            tangents = tuple(torch.zeros_like(of) if each is None else each for of, each in pairs)
            return jvp_by_vjp(reference(ctx.step, ctx.spec), ctx.saved_tensors, tangents)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *inputs: Any) -> tuple[Tensor, int]:
            size, (*tensors, step, spec) = info.batch_size, inputs
            parts = [_first(x, dim, size) for x, dim in zip(tensors, in_dims, strict=False)]
            output = _applied(Derivative, *(part.flatten(0, 1) for part in parts), step, spec)
            return output.unflatten(0, parts[0].shape[:2]), 0

    return Derivative


_Vjp = _derivative(
    "vjp", lambda step, spec: lambda x, grad: torch.func.vjp(lambda of: step.reference(of, spec), x)[1](grad)[0]
)
_Jvp = _derivative(
    "jvp", lambda step, spec: lambda x, tangent: jvp_by_vjp(lambda of: step.reference(of, spec), (x,), (tangent,))
)


def in_graph(x: Tensor) -> bool:
    """True for traced or fake tensors."""
    tracing = torch.compiler.is_compiling() or torch.jit.is_tracing()  # type: ignore[attr-defined, no-untyped-call]
    return tracing or type(x) not in (Tensor, Parameter)


def norm_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels)."""
    return normalize_reference(histograms.permute(0, 3, 1, 2), spec).permute(0, 2, 3, 1)


def cells_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, rows, cols, bins)."""
    return histograms_reference(images, spec).permute(0, 2, 3, 1)


def describe_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-7."""
    return norm_reference(cells_reference(images, spec), spec)


def apply(step: Step, x: Tensor, spec: HOGSpec) -> Tensor:
    """The step's output for its input ``x``."""
    if not _no_transforms():
        output: Tensor = _applied(_Run, x, step, spec)[0]
        return output
    if x.requires_grad and torch.is_grad_enabled():
        return _simple(x, step, spec)
    return step.run(x.detach(), spec)[0]
