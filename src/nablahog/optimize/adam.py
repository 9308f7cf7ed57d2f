"""Adam (Kingma & Ba, ICLR 2015) on a batch of independent problems."""

from __future__ import annotations

import torch
from torch import Tensor
from typing_extensions import Unpack

from .descent import descend
from .result import Minimum, ObjectiveFunction, Stopping


def adam(
    objective: ObjectiveFunction,
    start: Tensor,
    *,
    first_step: float = 1.0,
    betas: tuple[float, float] = (0.9, 0.999),
    **stopping: Unpack[Stopping],
) -> Minimum:
    """Minimise a batch of problems.

    Args:
        objective: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        first_step: length of the very first step, in the norm of the unknowns: Adam's α is first_step / √N.  See
            :mod:`.descent` for what follows.
        betas: shares that the running means of the gradient and of its square keep.
        stopping: see :class:`.result.Stopping`.

    Returns:
        For each problem the lowest point found, never worse than its start.
    """
    beta1, beta2 = betas

    def rule(gradient: Tensor, first: Tensor, second: Tensor, age: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Remembers the means of the gradient and of its square, to be corrected for their start at 0 by their age."""
        age = age + 1
        first = beta1 * first + (1 - beta1) * gradient
        second = beta2 * second + (1 - beta2) * gradient.square()
        mean = first / (1 - beta1**age)
        spread = (second / (1 - beta2**age)).sqrt()
        # the paper's 1e-8 would be a scale of the objective; this only is where squares underflow
        return -mean / (spread + torch.finfo(mean.dtype).tiny ** 0.5), (first, second, age)

    def step_size(gradient: Tensor) -> Tensor:
        return torch.full_like(gradient[:, 0], first_step / gradient.shape[1] ** 0.5)

    memory = torch.zeros_like(start), torch.zeros_like(start), torch.zeros_like(start[:, :1])
    return descend(objective, start, rule, memory, step_size, **stopping)
