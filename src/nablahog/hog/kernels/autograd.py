"""The compiled steps as functions that PyTorch can differentiate, in reverse and in forward mode, and map over batches.

Second derivatives are those of the plain steps: nothing but their speed would be won.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor
from torch.autograd import Function, forward_ad

from ..normalize import normalize
from ..spec import HOGSpec
from ..steps import plain_histograms
from . import loops

Both: TypeAlias = tuple[Tensor, Tensor]


@dataclass(frozen=True)
class Step:
    """A compiled step, its derivatives in both modes, and the plain step that it is.

    Attributes:
        run: from the input and the dialect to the output, and an array of what else the derivatives want to know.
        vjp: from the input, that, and what reaches the output, to what reaches the input.
        jvp: from the input, that, and how the input changes, to how the output changes.
        reference: from the input to the output.
    """

    run: Callable[[Tensor, HOGSpec], tuple[Tensor, Any]]
    vjp: Callable[[Tensor, Any, Tensor, HOGSpec], Tensor]
    jvp: Callable[[Tensor, Any, Tensor, HOGSpec], Tensor]
    reference: Callable[[Tensor, HOGSpec], Tensor]


def _applied(function: type[Function], *inputs: Any) -> Any:
    return function.apply(*inputs)  # type: ignore[no-untyped-call]


def _first(x: Tensor, dim: int | None, size: int) -> Tensor:
    """A mapped dimension in front, or a new one."""
    return x.expand(size, *x.shape) if dim is None else x.movedim(dim, 0)


def _jvp(function: Callable[..., Tensor], at: tuple[Tensor, ...], changes: tuple[Tensor, ...]) -> Tensor:
    """How a function's value changes, by the adjoint of its adjoint: forward mode cannot be nested in itself."""
    value, pull = torch.func.vjp(function, *at)[:2]
    found: Tensor = torch.func.vjp(pull, torch.zeros_like(value))[1](changes)[0]
    return found


_transforms_active: Callable[[], bool] = getattr(torch._C, "_are_functorch_transforms_active", lambda: True)


# several gradients at a time, by ``is_grads_batched`` of torch.autograd.grad, hide from all functions but PyTorch's own
_batched: Callable[[Tensor], bool] = getattr(torch._C._functorch, "is_legacy_batchedtensor", lambda _: False)


def _as_they_seem() -> bool:
    """Whether tensors are what they seem: no transform of ``torch.func`` and no forward mode is under way."""
    return not _transforms_active() and forward_ad._current_level < 0


def _vjp_of_reference(x: Tensor, given: Tensor, step: Step, spec: HOGSpec) -> Tensor:
    with torch.enable_grad():
        x = x.detach().requires_grad_()
        return torch.autograd.grad(step.reference(x, spec), x, given)[0]


class _Simple(Function):
    """As :class:`_Run`, in a fifth of the time that PyTorch takes for that, where no transform is under way."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, step: Step, spec: HOGSpec) -> Tensor:
        found, ctx.kept = step.run(x.detach(), spec)
        ctx.step, ctx.spec = step, spec
        ctx.save_for_backward(x)
        return found

    @staticmethod
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None, None]:
        (x,), kept = ctx.saved_tensors, ctx.kept
        if _batched(given):
            return _vjp_of_reference(x, given, ctx.step, ctx.spec), None, None
        if torch.is_grad_enabled() or not _as_they_seem():
            return _applied(_Vjp, x, torch.from_numpy(kept), given, ctx.step, ctx.spec), None, None
        return ctx.step.vjp(x.detach(), kept, given, ctx.spec), None, None


# without looking for transforms once more
_simple: Callable[[Tensor, Step, HOGSpec], Tensor] = super(Function, _Simple).apply


class _Run(Function):
    @staticmethod
    def forward(x: Tensor, step: Step, spec: HOGSpec) -> Both:
        found, kept = step.run(x.detach(), spec)
        return found, torch.from_numpy(kept)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, Step, HOGSpec], output: Both) -> None:
        x, ctx.step, ctx.spec = inputs
        ctx.mark_non_differentiable(output[1])
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(x, output[1])
        ctx.save_for_forward(x, output[1])

    @staticmethod
    def backward(ctx: Any, given: Tensor | None, _: Tensor | None) -> tuple[Tensor | None, None, None]:
        if given is None:
            return None, None, None
        return _applied(_Vjp, *ctx.saved_tensors, given, ctx.step, ctx.spec), None, None

    @staticmethod
    def jvp(ctx: Any, change: Tensor | None, *_: None) -> tuple[Tensor | None, None]:
        if change is None:
            return None, None
        return _applied(_Jvp, *ctx.saved_tensors, change, ctx.step, ctx.spec), None

    @staticmethod
    def vmap(info: Any, in_dims: Any, x: Tensor, step: Step, spec: HOGSpec) -> tuple[Both, tuple[int, int]]:
        mapped = x.movedim(in_dims[0], 0)
        found, kept = _applied(_Run, mapped.flatten(0, 1), step, spec)
        return (found.unflatten(0, mapped.shape[:2]), kept.unflatten(0, mapped.shape[:2])), (0, 0)


class _Derivative(Function):
    """What :class:`_Vjp` and :class:`_Jvp` have in common: both are linear in the last of three tensors."""

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, Tensor, Tensor, Step, HOGSpec], output: Tensor) -> None:
        x, _kept, along, ctx.step, ctx.spec = inputs
        ctx.save_for_backward(x, along)
        ctx.save_for_forward(x, along)

    @staticmethod
    def plain(step: Step, spec: HOGSpec) -> Callable[[Tensor, Tensor], Tensor]:
        """The same function of the first and the last, of plain steps."""
        raise NotImplementedError

    @classmethod
    def second_vjp(cls, ctx: Any, given: Tensor) -> tuple[Tensor | None, ...]:
        pull = torch.func.vjp(cls.plain(ctx.step, ctx.spec), *ctx.saved_tensors)[1]
        to_x, to_along = pull(given)
        return to_x, None, to_along, None, None

    @classmethod
    def second_jvp(
        cls, ctx: Any, change_of_x: Tensor | None, _: Tensor | None, change: Tensor | None, *__: None
    ) -> Tensor:
        x, along = ctx.saved_tensors
        changes = (torch.zeros_like(of) if c is None else c for of, c in ((x, change_of_x), (along, change)))
        return _jvp(cls.plain(ctx.step, ctx.spec), (x, along), tuple(changes))

    @classmethod
    def mapped(cls, info: Any, in_dims: Any, *inputs: Any) -> tuple[Tensor, int]:
        size, (*tensors, step, spec) = info.batch_size, inputs
        parts = [_first(x, dim, size) for x, dim in zip(tensors, in_dims, strict=False)]
        found = _applied(cls, *(part.flatten(0, 1) for part in parts), step, spec)
        return found.unflatten(0, parts[0].shape[:2]), 0


class _Vjp(_Derivative):
    @staticmethod
    def forward(x: Tensor, kept: Tensor, given: Tensor, step: Step, spec: HOGSpec) -> Tensor:
        return step.vjp(x.detach(), loops.array(kept.detach()), given.detach(), spec)

    @staticmethod
    def plain(step: Step, spec: HOGSpec) -> Callable[[Tensor, Tensor], Tensor]:
        return lambda x, given: torch.func.vjp(lambda of: step.reference(of, spec), x)[1](given)[0]

    @staticmethod
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor | None, ...]:
        return _Vjp.second_vjp(ctx, given)

    @staticmethod
    def jvp(ctx: Any, *changes: Any) -> Tensor:
        return _Vjp.second_jvp(ctx, *changes)

    @staticmethod
    def vmap(info: Any, in_dims: Any, *inputs: Any) -> tuple[Tensor, int]:
        return _Vjp.mapped(info, in_dims, *inputs)


class _Jvp(_Derivative):
    @staticmethod
    def forward(x: Tensor, kept: Tensor, change: Tensor, step: Step, spec: HOGSpec) -> Tensor:
        return step.jvp(x.detach(), loops.array(kept.detach()), change.detach(), spec)

    @staticmethod
    def plain(step: Step, spec: HOGSpec) -> Callable[[Tensor, Tensor], Tensor]:
        return lambda x, change: _jvp(lambda of: step.reference(of, spec), (x,), (change,))

    @staticmethod
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor | None, ...]:
        return _Jvp.second_vjp(ctx, given)

    @staticmethod
    def jvp(ctx: Any, *changes: Any) -> Tensor:
        return _Jvp.second_jvp(ctx, *changes)

    @staticmethod
    def vmap(info: Any, in_dims: Any, *inputs: Any) -> tuple[Tensor, int]:
        return _Jvp.mapped(info, in_dims, *inputs)


def _nothing(images: Tensor) -> Any:
    return np.empty((len(images), 0), np.float32)


def _norm_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    return normalize(histograms.permute(0, 3, 1, 2), spec).permute(0, 2, 3, 1)


def _cells_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    return plain_histograms(images, spec).permute(0, 2, 3, 1)


def _norm_jvp(histograms: Tensor, _: Any, change: Tensor, spec: HOGSpec) -> Tensor:
    # cells are few: the plain step is fast enough
    return _jvp(lambda x: _norm_reference(x, spec), (histograms,), (change,))


def _describe_jvp(images: Tensor, cells: Any, change: Tensor, spec: HOGSpec) -> Tensor:
    return _norm_jvp(torch.from_numpy(cells), None, loops.cells_jvp(images, change, spec), spec)


CELLS = Step(
    lambda images, spec: (loops.cells(images, spec), _nothing(images)),
    lambda images, _, given, spec: loops.cells_vjp(images, given, spec),
    lambda images, _, change, spec: loops.cells_jvp(images, change, spec),
    _cells_reference,
)
NORM = Step(
    lambda histograms, spec: (loops.norm(histograms, spec), _nothing(histograms)),
    lambda histograms, _, given, spec: loops.norm_vjp(histograms, given, spec),
    _norm_jvp,
    _norm_reference,
)
DESCRIBE = Step(
    loops.describe,
    loops.describe_vjp,
    _describe_jvp,
    lambda images, spec: _norm_reference(_cells_reference(images, spec), spec),
)


def apply(step: Step, x: Tensor, spec: HOGSpec) -> Tensor:
    """The step's output for its input ``x``."""
    if not _as_they_seem():
        found: Tensor = _applied(_Run, x, step, spec)[0]
        return found
    if x.requires_grad and torch.is_grad_enabled():
        found = _simple(x, step, spec)
        return found
    return step.run(x.detach(), spec)[0]
