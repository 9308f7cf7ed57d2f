"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point; a problem whose trial is accepted moves on to
its next direction at once, one whose trial is not shrinks or grows its step: no problem waits for another.  The line
search is Lewis & Overton's bracketing for the weak Wolfe conditions, which copes with the kinks of piecewise smooth
objectives (Math. Program. 141, 2013).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..compile import compiled
from .result import BUDGET, GRADIENT, LINE_SEARCH, PROGRESS, WINDOW, Minimum, Objective, Watch

ARMIJO, CURVATURE = 1e-4, 0.9  # constants of the Wolfe conditions, Nocedal & Wright p. 62


@compiled
def _two_loops(products: Any, with_gradient: Any, pairs: Any) -> tuple[Any, Any]:
    """H·gradient = γ·gradient + Σ coefficient·vector (algorithm 7.4), for each problem.

    Takes the dot products of the stored vectors with each other (B, 2m, 2m) and with the gradient (B, 2m), and the
    number of pairs stored so far (B,).  Returns γ (B,) and the coefficients (B, 2m).
    """
    batch, both = with_gradient.shape
    m = both // 2
    gammas, found = np.ones_like(with_gradient[:, 0]), np.zeros_like(with_gradient)
    alphas = np.zeros_like(with_gradient[0, :m])
    for i in range(batch):
        product, gradient, coefficients = products[i], with_gradient[i], found[i]
        stored = min(m, pairs[i])
        for age in range(1, stored + 1):
            at = (pairs[i] - age) % m
            alpha = gradient[at]
            for k in range(both):
                alpha += product[at, k] * coefficients[k]
            alphas[at] = alpha / product[at, at + m]
            coefficients[at + m] -= alphas[at]
        if stored > 0:
            at = (pairs[i] - 1) % m
            gammas[i] = product[at, at + m] / product[at + m, at + m]
        for k in range(both):
            coefficients[k] *= gammas[i]
        for age in range(stored, 0, -1):
            at = (pairs[i] - age) % m
            beta = gammas[i] * gradient[at + m]
            for k in range(both):
                beta += product[at + m, k] * coefficients[k]
            coefficients[at] += alphas[at] - beta / product[at, at + m]
    return gammas, found


class _Memory:
    """The last ``size`` steps s and gradient changes y of each problem, with all their dot products.

    Holding the dot products lets the two-loop recursion run on 2·size coefficients a problem; the long vectors are
    read twice a round, once for the products with the new ones and once to combine them (Chen et al., NeurIPS 2014).
    """

    def __init__(self, like: Tensor, size: int) -> None:
        batch, n = like.shape
        self.size = size
        self.vectors = like.new_zeros(batch, 2 * size, n)  # s in the first half, y in the second
        self.products = like.new_zeros(batch, 2 * size, 2 * size)
        self.pairs = torch.zeros(batch, dtype=torch.long, device=like.device)  # stored so far

    def keep(self, rows: Tensor) -> None:
        """Keep only the problems ``rows``."""
        self.vectors, self.products, self.pairs = self.vectors[rows], self.products[rows], self.pairs[rows]

    def forget(self, rows: Tensor) -> None:
        """Empty the memory of the problems ``rows``."""
        self.pairs[rows] = 0

    def update(self, stored: Tensor, s: Tensor, y: Tensor, gradient: Tensor) -> Tensor:
        """Store s and y, over the oldest pair, where ``stored`` (B,) says so; then -H·gradient, all (B, N).

        The two-loop recursion (Nocedal & Wright, algorithm 7.4), on the coefficients of the stored vectors.
        """
        m = self.size
        slot = self.pairs % m
        new, at = stored.nonzero().squeeze(1), slot[stored]
        self.vectors[new, at], self.vectors[new, at + m] = s[new], y[new]
        with_s, with_y, with_gradient = (self.vectors @ torch.stack([s, y, gradient], dim=1).mT).unbind(dim=2)
        for products, position in ((with_s, at), (with_y, at + m)):
            self.products[new, position] = products[new]
            self.products[new, :, position] = products[new]
        self.pairs += stored

        small = (x.cpu().numpy() for x in (self.products, with_gradient, self.pairs))
        gamma, coefficients = (torch.from_numpy(x).to(gradient) for x in _two_loops(*small))
        return -(gamma.unsqueeze(1) * gradient + (coefficients.unsqueeze(1) @ self.vectors).squeeze(1))


def lbfgs(
    objective: Objective,
    start: Tensor,
    *,
    max_evaluations: int = 300,
    memory: int = 8,
    first_step: float = 1.0,
    gradient_tolerance: float = 0.0,
    progress_tolerance: float = 0.0,
    watch: Watch | None = None,
) -> Minimum:
    """Minimise a batch of problems.

    Args:
        objective: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        max_evaluations: budget of each problem.
        memory: stored pairs.
        first_step: length of the very first trial step, in the norm of the unknowns.
        gradient_tolerance: stop a problem whose largest absolute gradient entry is at most this.
        progress_tolerance: stop a problem whose value fell by less than this share of itself in 20 evaluations.
        watch: see :data:`Watch`.

    Returns:
        For each problem the lowest point found, never worse than its start.
    """
    x = start.clone()
    index = torch.arange(len(x), device=x.device)  # which problem each row of the running state is
    value, gradient = objective(x, index)
    result, result_value = x.clone(), value.clone()
    reasons = [BUDGET] * len(x)
    evaluations = torch.ones(len(x), dtype=torch.long, device=x.device)
    history = [value.clone()]
    if watch is not None:
        watch(index, evaluations)

    def steepest(gradient: Tensor) -> Tensor:
        norm = gradient.norm(dim=1, keepdim=True)
        return -gradient * torch.where(norm > 0, first_step / norm, 0)

    pairs = _Memory(x, memory)
    direction = steepest(gradient)
    slope = (gradient * direction).sum(1)
    step = torch.ones_like(value)
    low, high = torch.zeros_like(value), torch.full_like(value, torch.inf)

    for evaluation in range(2, max_evaluations + 1):
        trial = x + step.unsqueeze(1) * direction
        trial_value, trial_gradient = objective(trial, index)
        evaluations[index] += 1
        if watch is not None:
            watch(index, evaluations[index])

        enough = trial_value <= value + ARMIJO * step * slope  # False for NaN
        accepted = enough & ((trial_gradient * direction).sum(1) >= CURVATURE * slope)
        if accepted.any():
            move = accepted.unsqueeze(1)
            s, y = step.unsqueeze(1) * direction, trial_gradient - gradient
            curved = (s * y).sum(1) > torch.finfo(x.dtype).eps * y.square().sum(1)
            x, value = torch.where(move, trial, x), torch.where(accepted, trial_value, value)
            gradient = torch.where(move, trial_gradient, gradient)
            turned = pairs.update(accepted & curved, s, y, gradient)
            turned_slope = (gradient * turned).sum(1)
            uphill = accepted & ~(turned_slope < 0)
            if uphill.any():  # rounding has spoilt the memory
                pairs.forget(uphill)
                turned = torch.where(uphill.unsqueeze(1), steepest(gradient), turned)
                turned_slope = (gradient * turned).sum(1)
            direction = torch.where(move, turned, direction)

        # too long a step bounds the bracket from above, too short a one from below
        high = torch.where(enough, high, step)
        low = torch.where(enough & ~accepted, step, low)
        # the minimum of the parabola through both values and the slope
        parabola = -slope * step * step / (2 * (trial_value - value - step * slope))
        width = high - low
        inside = torch.where(low == 0, parabola.nan_to_num(0, 0, 0), low + width / 2)
        inside = torch.clamp(inside, low + width / 10, high - width / 10)
        step = torch.where(high.isinf(), 2 * low, inside)
        stuck = ~accepted & (step * direction.abs().amax(1) <= torch.finfo(x.dtype).eps * x.abs().amax(1))
        if accepted.any():
            slope = torch.where(accepted, turned_slope, slope)
            step = torch.where(accepted, 1, step)
            low, high = torch.where(accepted, 0, low), torch.where(accepted, torch.inf, high)

        current = history[-1].clone()
        current[index] = value
        history.append(current)
        flat = gradient.abs().amax(1) <= gradient_tolerance
        slow = torch.zeros_like(stuck)
        if evaluation > WINDOW:
            slow = history[-1 - WINDOW][index] - value < progress_tolerance * value
        done = flat | stuck | slow
        if done.any():
            for i, why in ((flat, GRADIENT), (slow & ~flat, PROGRESS), (stuck & ~flat & ~slow, LINE_SEARCH)):
                for problem in index[i].tolist():
                    reasons[problem] = why
            result[index[done]], result_value[index[done]] = x[done], value[done]
            go_on = ~done
            if not go_on.any():
                index = index[go_on]
                break
            pairs.keep(go_on)
            index, x, value, gradient = index[go_on], x[go_on], value[go_on], gradient[go_on]
            direction, slope, step = direction[go_on], slope[go_on], step[go_on]
            low, high = low[go_on], high[go_on]
    result[index], result_value[index] = x[: len(index)], value[: len(index)]
    return Minimum(result, result_value, evaluations, reasons, torch.stack(history))
