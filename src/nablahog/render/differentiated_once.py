"""Images whose second derivatives are refused: rendering holds still what only these would move."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


class DifferentiatedOnce(torch.autograd.Function):
    """An image, as a function of poses, vertices, the mesh's brightness and the background.

    It is linear in the latter two, and by these can be differentiated again.
    """

    generate_vmap_rule = True

    @staticmethod
    def forward(image: Tensor, *_: Tensor) -> Tensor:
        return image.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, ...], output: Tensor) -> None:
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs[1:])
        ctx.save_for_forward(*inputs[1:])

    @staticmethod
    def backward(ctx: Any, grad: Tensor | None) -> tuple[Tensor | None, ...]:
        return _first_derivative(grad, ctx.saved_tensors, any(ctx.needs_input_grad[1:3])), None, None, None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor | None, *of_inputs: Tensor | None) -> Tensor | None:
        moved = any(each is not None for each in of_inputs[:2])
        return _first_derivative(tangent, ctx.saved_tensors, moved)


def _first_derivative(values: Tensor | None, inputs: tuple[Tensor, ...], moved: bool) -> Tensor | None:
    """A derivative, by poses or vertices if the image ``moved``, which knows what it cannot be differentiated by."""
    if values is None:
        return None
    return _FirstDerivative.apply(values, *(inputs if moved else inputs[:2]))  # type: ignore[no-any-return, no-untyped-call]


class _FirstDerivative(torch.autograd.Function):
    """A derivative of an image, linear in what it was multiplied by."""

    generate_vmap_rule = True

    @staticmethod
    def forward(derivative: Tensor, *_: Tensor) -> Tensor:
        return derivative.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, ...], output: Tensor) -> None:
        ctx.set_materialize_grads(False)

    @staticmethod
    def backward(ctx: Any, grad: Tensor | None) -> tuple[Tensor | None, ...]:
        _refuse(any(ctx.needs_input_grad[1:]))
        return grad, *(None for _ in ctx.needs_input_grad[1:])

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor | None, *of_inputs: Tensor | None) -> Tensor | None:
        _refuse(any(each is not None for each in of_inputs))
        return tangent


def _refuse(wanted: bool) -> None:
    if wanted:
        raise NotImplementedError("rendered images can be differentiated once, not twice")
