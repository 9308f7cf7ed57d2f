"""A loss for training: how far the descriptors of images are from those of others."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import torch
from torch import Tensor, nn

from ..inputs.numbers import check_choice
from .descriptor import HALVES, hog
from .dialects import as_spec
from .spec import HOGSpec

Reduction: TypeAlias = Literal["mean", "sum", "none"]


class HOGLoss(nn.Module):
    """‖φ(x) - φ(y)‖² / ‖φ(y)‖² of images x and targets y, where φ is the HOG; a module without parameters.

    It is the square of the distance that :func:`nablahog.reconstruct` lowers and reports: 0 where the descriptors
    agree, and 1 for an x without edges.  Where a target has no edges, φ(y) = 0, it is the mean square of φ(x).

    Args:
        spec: the dialect, or the name of a preset with its defaults.  A dialect of hard votes has a derivative by
            gradient magnitudes alone (``docs/derivatives.md``).
        reduction: over the batch: ``"mean"``, ``"sum"``, or ``"none"`` for one value an image.

    Raises:
        ValueError: there is no such preset or reduction.

    >>> loss = nablahog.HOGLoss("uoctti")
    >>> images, targets = torch.rand(2, 3, 64, 48, requires_grad=True), torch.rand(2, 3, 64, 48)
    >>> loss(images, targets).backward()
    >>> float(loss(targets, targets))
    0.0
    """

    def __init__(self, spec: HOGSpec | str, *, reduction: Reduction = "mean") -> None:
        super().__init__()
        check_choice("reduction", reduction, Reduction)
        self.spec = as_spec(spec)
        self.reduction: Reduction = reduction

    def forward(self, images: Tensor, targets: Tensor) -> Tensor:
        """Images and targets (B, C, H, W), as for :func:`hog`, to the loss: a number, or (B,) with ``"none"``.

        It is in float32, or float64 if one of the two is.  Differentiable in both; either may be uint8.

        Raises:
            TypeError, ValueError: they are not tensors of one shape, or :func:`hog` does not take them.
        """
        pair = images, targets
        shape, target_shape = (x.shape if isinstance(x, Tensor) else type(x).__name__ for x in pair)
        if shape != target_shape or isinstance(shape, str):
            raise ValueError(
                f"images and targets must be tensors (B, C, H, W) of one shape, got {shape} and {target_shape}"
            )
        descriptors, expected = (hog(x.float() if x.dtype in HALVES else x, self.spec) for x in pair)
        size = expected.square().sum((1, 2, 3))
        scale = torch.where(size > 0, size, math.prod(expected.shape[1:]))
        losses = (descriptors - expected).square().sum((1, 2, 3)) / scale
        return losses if self.reduction == "none" else getattr(losses, self.reduction)()

    def extra_repr(self) -> str:
        return f"{self.spec.name}, reduction={self.reduction!r}"
