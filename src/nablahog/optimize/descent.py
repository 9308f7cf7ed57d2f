"""Descent without a line search, the part that momentum and Adam share: how far to go, when to go back, when to stop.

Each step goes where the rule says, downhill or not.  The step size of a problem grows a little with each new lowest
point; when there has been none for some evaluations, or a value is not finite, the problem goes back to its lowest
point and starts anew from there with half the step size (the "bold driver", Vogl et al., Biol. Cybern. 59, 1988).
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from .result import WINDOW, Minimum, ObjectiveFunction, StopReason, Watch

GROWTH, SHRINKAGE = 1.05, 0.5
PATIENCE = 5  # evaluations without a new lowest point


class Rule(Protocol):
    """Where to go from the gradients seen so far, for a batch."""

    def move(self, gradient: Tensor) -> Tensor:
        """Gradients (A, N) at the current points to displacements (A, N) for a step size of 1."""
        ...

    def restart(self, which: Tensor) -> None:
        """Forget the gradients of the problems for which ``which`` (A,) holds."""
        ...

    def keep(self, which: Tensor) -> None:
        """Keep only the problems for which ``which`` (A,) holds."""
        ...


def descend(
    objective: ObjectiveFunction,
    x: Tensor,
    value: Tensor,
    gradient: Tensor,
    rule: Rule,
    step: Tensor,
    *,
    max_evaluations: int,
    gradient_tolerance: float,
    progress_tolerance: float,
    watch: Watch | None,
) -> Minimum:
    """Minimise a batch from points x (B, N), with their values (B,), gradients (B, N) and step sizes (B,)."""
    index = torch.arange(len(x), device=x.device)  # which problem each row of the running state is
    result, result_value = x.clone(), value.clone()
    reasons = [StopReason.BUDGET] * len(x)
    evaluations = torch.ones_like(index)
    history, lowest_values = [value.clone()], [value.clone()]
    if watch is not None:
        watch(index, evaluations)
    lowest, lowest_value, lowest_gradient = x, value, gradient
    waited = torch.zeros_like(index)
    bad = ~(value.isfinite() & gradient.isfinite().all(1))
    small = torch.zeros_like(bad)

    for evaluation in range(2, max_evaluations + 2):
        flat = lowest_gradient.abs().amax(1) <= gradient_tolerance
        slow = torch.zeros_like(flat)
        if evaluation > WINDOW + 1:
            slow = lowest_values[-1 - WINDOW][index] - lowest_value < progress_tolerance * lowest_value
        done = bad | flat | slow | small
        if done.any():
            for i, why in (
                (small, StopReason.STEP),
                (slow, StopReason.PROGRESS),
                (flat, StopReason.GRADIENT),
                (bad, StopReason.NOT_FINITE),
            ):  # the last one counts
                for problem in index[i].tolist():
                    reasons[problem] = why
            go_on = ~done
            rule.keep(go_on)
            index, step, waited = index[go_on], step[go_on], waited[go_on]
            x, value, gradient = x[go_on], value[go_on], gradient[go_on]
            lowest, lowest_value, lowest_gradient = lowest[go_on], lowest_value[go_on], lowest_gradient[go_on]
        if not len(index) or evaluation > max_evaluations:
            break

        shift = step.unsqueeze(1) * rule.move(gradient)
        small = shift.abs().amax(1) <= torch.finfo(x.dtype).eps * x.abs().amax(1)
        x = x + shift
        value, gradient = objective(x, index)
        evaluations[index] += 1
        if watch is not None:
            watch(index, evaluations[index])

        finite = value.isfinite() & gradient.isfinite().all(1)
        better = finite & (value < lowest_value)
        move = better.unsqueeze(1)
        lowest, lowest_gradient = torch.where(move, x, lowest), torch.where(move, gradient, lowest_gradient)
        lowest_value = torch.where(better, value, lowest_value)
        result[index], result_value[index] = lowest, lowest_value
        waited = torch.where(better, 0, waited + 1)
        back = ~finite | (waited >= PATIENCE)
        step = torch.where(back, SHRINKAGE * step, torch.where(better, GROWTH * step, step))
        waited = torch.where(back, 0, waited)
        move = back.unsqueeze(1)
        x, gradient = torch.where(move, lowest, x), torch.where(move, lowest_gradient, gradient)
        value = torch.where(back, lowest_value, value)
        rule.restart(back)
        bad = torch.zeros_like(back)
        for values, new in ((history, value), (lowest_values, lowest_value)):
            current = values[-1].clone()
            current[index] = new
            values.append(current)
    return Minimum(result, result_value, evaluations, reasons, torch.stack(history))
