"""Engines: tables of steps with their derivatives, which PyTorch then differentiates in all its modes.

C++ has all three steps, Triton the cells, and the reference none: it is operations of PyTorch.  Steps know one colour:
images of dialects with separate ones are batches of gray images (:func:`.steps.separate_colours`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, TypeAlias

import torch
from torch import Tensor
from torch.autograd import Function, forward_ad
from torch.nn import Parameter

from ..runtime.pytorch import transforms_active
from .spec import HOGSpec
from .steps import histograms_reference, normalize_reference, spread_nan

OutputAndSaved: TypeAlias = tuple[Tensor, Tensor]

# ``Any`` below is the type of what PyTorch passes to a Function untyped: ``ctx``, ``info`` and the inputs of ``vmap``


class Step(ABC):
    """A step of an engine, for a dialect of one colour and inputs of one shape and dtype.

    Args:
        spec: the dialect.
        shape: of an input, without the batch.
        stored: dtype of inputs.
        real: dtype of results: float32 or float64.
    """

    def __init__(self, spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype) -> None:
        self.spec = spec

    @cached_property
    def derivative_spec(self) -> HOGSpec:
        """The dialect whose derivative is meant."""
        jumps = self.spec.vote == "hard" and self.spec.derivative == "linear"
        return self.spec.with_linear_votes() if jumps else self.spec

    @abstractmethod
    def run(self, x: Tensor, saves: bool = True) -> OutputAndSaved:
        """The output, and a tensor (B, …) for the derivatives, which is arbitrary unless it ``saves``."""

    @abstractmethod
    def vjp(self, x: Tensor, saved: Tensor, grad_output: Tensor) -> Tensor:
        """The gradient of the input from that of the output."""

    @abstractmethod
    def jvp(self, x: Tensor, saved: Tensor, tangent: Tensor) -> Tensor:
        """The output's tangent from the input's."""

    @abstractmethod
    def reference(self, x: Tensor) -> Tensor:
        """The output by operations of PyTorch, which have all derivatives."""


class Cells(Step):
    """Eq. 1-6: images (B, C, H, W) to cells (B, rows, cols, bins)."""

    def reference(self, x: Tensor) -> Tensor:
        return histograms_reference(x, self.spec).permute(0, 2, 3, 1)


class Norm(Step):
    """Eq. 7: cells (B, rows, cols, bins) to descriptors (B, rows, cols, channels)."""

    def reference(self, x: Tensor) -> Tensor:
        return normalize_reference(x.permute(0, 3, 1, 2), self.spec).permute(0, 2, 3, 1)


class Describe(Step):
    """Eq. 1-7: images (B, C, H, W) to descriptors (B, rows, cols, channels)."""

    def reference(self, x: Tensor) -> Tensor:
        descriptors = normalize_reference(histograms_reference(x, self.spec), self.spec)
        return spread_nan(descriptors, x).permute(0, 2, 3, 1)


class Engine(NamedTuple):
    """The steps that an engine has for a dialect; the others are operations of PyTorch."""

    cells: type[Cells] | None = None
    norm: type[Norm] | None = None
    describe: type[Describe] | None = None


REFERENCE = Engine()


def real_dtype(stored: torch.dtype) -> torch.dtype:
    """The dtype that images are computed in: bytes in the default one, halves in float32."""
    if stored == torch.uint8:
        stored = torch.get_default_dtype()
    return torch.float64 if stored == torch.float64 else torch.float32


@lru_cache(maxsize=192)
def make_step(kind: type[Step], spec: HOGSpec, shape: torch.Size, stored: torch.dtype, real: torch.dtype) -> Step:
    """A step with its tables; made once."""
    return kind(spec, shape, stored, real)


def is_traced(x: Tensor) -> bool:
    """True for traced or fake tensors."""
    tracing = torch.compiler.is_compiling() or torch.jit.is_tracing()  # type: ignore[attr-defined, no-untyped-call]
    return tracing or type(x) not in (Tensor, Parameter)


# whether a gradient is batched (``is_grads_batched`` of torch.autograd.grad): only PyTorch's own functions can read it
_batched: Callable[[Tensor], bool] = getattr(torch._C._functorch, "is_legacy_batchedtensor", lambda _: False)


def apply(kind: type[Step], x: Tensor, spec: HOGSpec) -> Tensor:
    """The output of a step, differentiable in reverse and forward mode, and under ``vmap``.

    Second derivatives are those of the reference.
    """
    step = make_step(kind, spec, x.shape[1:], x.dtype, real_dtype(x.dtype))
    if transforms_active() or forward_ad._current_level >= 0:
        output: Tensor = _applied(_Run, x, step)[0]
        return output
    if x.requires_grad and torch.is_grad_enabled():
        return _run_simply(x, step)
    return step.run(x, saves=False)[0]


def run_jvp(kind: type[Cells], x: Tensor, tangent: Tensor, spec: HOGSpec) -> Tensor:
    """The tangent of the cells alone, which needs nothing of the forward pass."""
    step = make_step(kind, spec, x.shape[1:], x.dtype, real_dtype(x.dtype))
    return step.jvp(x, x.new_empty(len(x), 0), tangent)


class _RunSimply(Function):
    """:class:`_Run` where no transform is active: PyTorch's own overhead is a fifth."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, step: Step) -> Tensor:
        output, saved = step.run(x)
        ctx.step = step
        ctx.save_for_backward(x, saved)
        return output

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        (x, saved), step = ctx.saved_tensors, ctx.step
        if _batched(grad_output):
            with torch.enable_grad():
                x = x.detach().requires_grad_()
                return torch.autograd.grad(step.reference(x), x, grad_output)[0], None
        if torch.is_grad_enabled() or transforms_active() or forward_ad._current_level >= 0:
            return _applied(_Vjp, x, saved, grad_output, step), None
        return step.vjp(x, saved, grad_output.resolve_neg()), None


# the C++ function behind ``Function.apply``: unlike that, it does not check for transforms again
_run_simply: Callable[[Tensor, Step], Tensor] = super(Function, _RunSimply).apply


def _applied(function: type[Function], *inputs: Any) -> Any:
    return function.apply(*inputs)  # type: ignore[no-untyped-call]


class _Run(Function):
    @staticmethod
    def forward(x: Tensor, step: Step) -> OutputAndSaved:
        return step.run(x.detach())

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, Step], output: OutputAndSaved) -> None:
        x, ctx.step = inputs
        ctx.mark_non_differentiable(output[1])
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(x, output[1])
        ctx.save_for_forward(x, output[1])

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor | None, _: Tensor | None) -> tuple[Tensor | None, None]:
        if grad_output is None:
            return None, None
        return _applied(_Vjp, *ctx.saved_tensors, grad_output, ctx.step), None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor | None, *_: None) -> tuple[Tensor | None, None]:
        if tangent is None:
            return None, None
        return _applied(_Jvp, *ctx.saved_tensors, tangent, ctx.step), None

    @staticmethod
    def vmap(info: Any, in_dims: Any, x: Tensor, step: Step) -> tuple[OutputAndSaved, tuple[int, int]]:
        mapped = x.movedim(in_dims[0], 0)
        output, saved = _applied(_Run, mapped.flatten(0, 1), step)
        return (output.unflatten(0, mapped.shape[:2]), saved.unflatten(0, mapped.shape[:2])), (0, 0)


def jvp_by_vjp(function: Callable[..., Tensor], at: tuple[Tensor, ...], tangents: tuple[Tensor, ...]) -> Tensor:
    """The jvp as the vjp of the vjp: forward mode cannot be nested in itself."""
    value, vjp = torch.func.vjp(function, *at)[:2]
    tangent: Tensor = torch.func.vjp(vjp, torch.zeros_like(value))[1](tangents)[0]
    return tangent


def _first(x: Tensor, dim: int | None, size: int) -> Tensor:
    """Moves a mapped dimension to the front, or adds one."""
    return x.expand(size, *x.shape) if dim is None else x.movedim(dim, 0)


def _derivative(name: str, reference: Callable[[Step], Callable[[Tensor, Tensor], Tensor]]) -> type[Function]:
    """The function of PyTorch for ``Step.vjp`` or ``Step.jvp``; ``reference`` computes the same by the reference.

    It is linear in the last of its three tensors, ``direction``.
    """

    class Derivative(Function):
        @staticmethod
        def forward(x: Tensor, saved: Tensor, direction: Tensor, step: Step) -> Tensor:
            output: Tensor = getattr(step, name)(x.detach(), saved.detach(), direction.detach())
            return output

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple[Tensor, Tensor, Tensor, Step], output: Tensor) -> None:
            x, _, direction, ctx.step = inputs
            ctx.save_for_backward(x, direction)
            ctx.save_for_forward(x, direction)

        @staticmethod
        def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor | None, ...]:
            grad_x, grad_direction = torch.func.vjp(reference(ctx.step), *ctx.saved_tensors)[1](grad_output)
            return grad_x, None, grad_direction, None

        @staticmethod
        def jvp(ctx: Any, tangent_x: Tensor | None, _: Tensor | None, tangent: Tensor | None, __: None) -> Tensor:
            pairs = zip(ctx.saved_tensors, (tangent_x, tangent), strict=True)
            tangents = tuple(torch.zeros_like(point) if along is None else along for point, along in pairs)
            return jvp_by_vjp(reference(ctx.step), ctx.saved_tensors, tangents)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *inputs: Any) -> tuple[Tensor, int]:
            size, (*tensors, step) = info.batch_size, inputs
            mapped = [_first(x, dim, size) for x, dim in zip(tensors, in_dims, strict=False)]
            output = _applied(Derivative, *(x.flatten(0, 1) for x in mapped), step)
            return output.unflatten(0, mapped[0].shape[:2]), 0

    return Derivative


_Vjp = _derivative("vjp", lambda step: lambda x, grad: torch.func.vjp(step.reference, x)[1](grad)[0])
_Jvp = _derivative("jvp", lambda step: lambda x, tangent: jvp_by_vjp(step.reference, (x,), (tangent,)))
