"""The long vectors of a batch of L-BFGS searches: points, gradients, directions, and stored pairs.

A round reads the stored vectors twice: for their dot products with the new gradient, and to combine them.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..runtime.threads import share_out
from . import lbfgs_kernels
from .lbfgs_decisions import ALONG, BESIDE, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW


class LbfgsVectors:
    """Vectors on any device: compiled loops on a CPU (:mod:`.lbfgs_kernels`), in as many threads as PyTorch takes,
    elsewhere PyTorch.

    Attributes:
        x, gradient, direction: (B, N), contiguous.
        stored: (B, 2m, N), the last m steps s, then the last m gradient changes y.
        compiled: whether the loops are used; both compute the same, up to rounding.
    """

    def __init__(self, x: Tensor, gradient: Tensor, direction: Tensor, memory: int) -> None:
        self.x, self.gradient, self.direction = x, gradient, direction
        self.stored = x.new_zeros(len(x), 2 * memory, x.shape[1])
        self.compiled = x.device.type == "cpu"

    def dots(self, trial_gradient: Tensor) -> Tensor:
        """(B, 2m + 4), as :func:`.lbfgs_decisions.decide` takes them, on the CPU."""
        if self.compiled:
            out = trial_gradient.new_empty(len(self.stored), self.stored.shape[1] + BESIDE)
            vectors = (trial_gradient, self.gradient, self.direction, self.stored)
            arrays = self.x.shape[1], *(each.view(-1).numpy() for each in vectors), out.numpy()
            share_out(lambda start, stop: lbfgs_kernels.dots(start, stop, *arrays), len(out))
            return out
        change = trial_gradient - self.gradient
        beside = [trial_gradient.new_empty(0)] * BESIDE
        for which, left, right in (
            (ALONG, trial_gradient, self.direction),
            (CHANGE_ALONG, change, self.direction),
            (CHANGE_SQUARED, change, change),
            (CHANGE_WITH_NEW, change, trial_gradient),
        ):
            beside[which] = torch.linalg.vecdot(left, right)
        with_stored = torch.bmm(trial_gradient.unsqueeze(1), self.stored.mT).squeeze(1)
        return torch.cat([with_stored, torch.stack(beside, dim=1)], dim=1).cpu()

    def take_step(
        self, taken: Tensor, places: Tensor, coefficients: Tensor, trial_gradient: Tensor, slopes: Tensor, peaks: Tensor
    ) -> None:
        """Takes the steps and updates the directions.

        Args:
            taken: (B,), the step as a multiple of the direction; 0 leaves a problem as it is.
            places: (B,), of s and y in the memory; -1 where they are not stored.
            coefficients: (B, 2m + 1) of the stored vectors and the gradient in the new direction.
            trial_gradient: (B, N).
            slopes, peaks: (B,), of those that move set to the slope along the new direction, and to the largest
                absolute number of the gradient.  These and the first three are on the CPU.
        """
        if self.compiled:
            numbers = (each.numpy() for each in (taken, places, coefficients))
            vectors = (trial_gradient, self.x, self.gradient, self.direction, self.stored)
            arrays = *numbers, *(each.view(-1).numpy() for each in vectors), slopes.numpy(), peaks.numpy()
            share_out(lambda start, stop: lbfgs_kernels.take_step(start, stop, *arrays), len(taken))
            return
        moved = taken > 0
        taken, places, coefficients, on_device = (t.to(self.x.device) for t in (taken, places, coefficients, moved))
        new = (places >= 0).nonzero().squeeze(1)
        step = taken.unsqueeze(1) * self.direction
        self.stored[new, places[new]] = step[new]
        self.stored[new, places[new] + self.stored.shape[1] // 2] = (trial_gradient - self.gradient)[new]
        self.x += step
        torch.where(on_device.unsqueeze(1), trial_gradient, self.gradient, out=self.gradient)
        direction = torch.bmm(coefficients[:, None, :-1], self.stored).squeeze(1)
        direction.addcmul_(coefficients[:, -1:], self.gradient)
        torch.where(on_device.unsqueeze(1), direction, self.direction, out=self.direction)
        slopes[moved] = torch.linalg.vecdot(self.gradient, self.direction).cpu()[moved]
        peaks[moved] = torch.linalg.vector_norm(self.gradient, torch.inf, dim=1).cpu()[moved]
