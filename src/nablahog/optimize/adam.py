"""Adam (Kingma & Ba, ICLR 2015) on a batch of independent problems."""

from __future__ import annotations

import torch
from torch import Tensor

from .descent import descend
from .result import Minimum, ObjectiveFunction, Watch


class _Moments:
    """Running means of the gradient and of its square, entry by entry, corrected for their start at 0."""

    def __init__(self, like: Tensor, betas: tuple[float, float]) -> None:
        self.betas = betas
        self.first, self.second = torch.zeros_like(like), torch.zeros_like(like)
        self.age = torch.zeros_like(like[:, :1])

    def displacement(self, gradient: Tensor) -> Tensor:
        beta1, beta2 = self.betas
        self.age += 1
        self.first = beta1 * self.first + (1 - beta1) * gradient
        self.second = beta2 * self.second + (1 - beta2) * gradient.square()
        mean = self.first / (1 - beta1**self.age)
        spread = (self.second / (1 - beta2**self.age)).sqrt()
        # the paper's 1e-8 would be a scale of the objective; this only is where squares underflow
        step: Tensor = -mean / (spread + torch.finfo(mean.dtype).tiny ** 0.5)
        return step

    def restart(self, mask: Tensor) -> None:
        self.first[mask], self.second[mask], self.age[mask] = 0, 0, 0

    def select(self, mask: Tensor) -> None:
        self.first, self.second, self.age = self.first[mask], self.second[mask], self.age[mask]


def adam(
    objective: ObjectiveFunction,
    start: Tensor,
    *,
    max_evaluations: int = 300,
    first_step: float = 1.0,
    betas: tuple[float, float] = (0.9, 0.999),
    gradient_tolerance: float = 0.0,
    progress_tolerance: float = 0.0,
    watch: Watch | None = None,
) -> Minimum:
    """Minimise a batch of problems.

    Args:
        objective: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        max_evaluations: budget of each problem.
        first_step: length of the very first step, in the norm of the unknowns: Adam's α is first_step / √N.  See
            :mod:`.descent` for what follows.
        betas: shares that the running means of the gradient and of its square keep.
        gradient_tolerance: stop a problem whose lowest point has no larger absolute gradient entry.
        progress_tolerance: stop a problem whose lowest value fell by less than this share of itself in 20 evaluations.
        watch: see :data:`Watch`.

    Returns:
        For each problem the lowest point found, never worse than its start.
    """
    x = start.detach().clone()
    value, gradient = objective(x, torch.arange(len(x), device=x.device))
    return descend(
        objective,
        x,
        value,
        gradient,
        _Moments(x, betas),
        torch.full_like(value, first_step / x.shape[1] ** 0.5),
        max_evaluations=max_evaluations,
        gradient_tolerance=gradient_tolerance,
        progress_tolerance=progress_tolerance,
        watch=watch,
    )
