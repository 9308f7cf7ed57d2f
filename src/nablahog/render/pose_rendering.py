"""Rendering as a function of poses, for autograd and ``torch.func``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from .camera import Camera, pose_jacobian, pose_vjp

# of nested derivatives, the inner one chooses how to render
_BY_BACKGROUND = "an image differentiated by poses cannot be differentiated by the background in an outer derivative"


class PoseRendering(torch.autograd.Function):
    """Poses (B, 6) and a background to images (B, H, W) and their screen gradient.

    Further arguments: :meth:`.Renderer.render`, its camera, and whether poses are differentiated.
    """

    @staticmethod
    def forward(
        poses: Tensor, background: Tensor, render: Callable[..., tuple[Tensor, Tensor]], _: Camera, derivative: bool
    ) -> tuple[Tensor, Tensor]:
        image, screen_gradient = render(poses, background, derivative=derivative)
        return image.clamp_(0, 1), screen_gradient

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(output[1])
        ctx.save_for_backward(inputs[0], output[1])
        ctx.save_for_forward(inputs[0], output[1])
        ctx.camera = inputs[3]

    @staticmethod
    def backward(ctx: Any, grad_image: Tensor | None, _: None) -> tuple[Tensor | None, None, None, None, None]:
        if ctx.needs_input_grad[1]:
            raise NotImplementedError(_BY_BACKGROUND)
        if grad_image is None:
            return None, None, None, None, None
        poses, screen_gradient = ctx.saved_tensors
        return pose_vjp(grad_image, screen_gradient, poses, ctx.camera).to(poses), None, None, None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor | None, *_: Any) -> tuple[Tensor, None]:
        if tangent is None:
            raise NotImplementedError(_BY_BACKGROUND)
        poses, screen_gradient = ctx.saved_tensors
        jacobian = pose_jacobian(screen_gradient, poses, ctx.camera)
        return torch.einsum("bk,bkhw->bhw", tangent.to(jacobian), jacobian), None

    @staticmethod
    def vmap(info: Any, in_dims: Any, *inputs: Any) -> tuple[tuple[Tensor, Tensor], tuple[None, None]]:
        # jacfwd maps over tangents; poses cannot be mapped over, because their numbers are read
        return PoseRendering.apply(*inputs), (None, None)  # type: ignore[no-untyped-call]
