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
LINE = 16  # numbers of a cache line, at least
REASONS = (BUDGET, GRADIENT, PROGRESS, LINE_SEARCH)


@compiled
def _two_loops(products: Any, with_gradient: Any, pairs: Any) -> tuple[Any, Any]:
    """H·gradient = γ·gradient + Σ coefficient·vector (algorithm 7.4), for each problem.

    Takes the dot products of the stored gradient changes with all stored vectors (B, m, 2m) and of these with the
    gradient (B, 2m), and the number of pairs stored so far (B,).  Returns γ (B,) and the coefficients (B, 2m).
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
            for newer in range(1, age):
                k = (pairs[i] - newer) % m
                alpha += product[k, at] * coefficients[k + m]
            alphas[at] = alpha / product[at, at]
            coefficients[at + m] -= alphas[at]
        if stored > 0:
            at = (pairs[i] - 1) % m
            gammas[i] = product[at, at] / product[at, at + m]
        for k in range(both):
            coefficients[k] *= gammas[i]
        for age in range(stored, 0, -1):
            at = (pairs[i] - age) % m
            beta = gammas[i] * gradient[at + m]
            for k in range(both):  # those of newer steps are still 0
                beta += product[at, k] * coefficients[k]
            coefficients[at] += alphas[at] - beta / product[at, at]
    return gammas, found


def _dot(a: Tensor, b: Tensor) -> Tensor:
    """Of the rows of a and b (B, N): (B,)."""
    found: Tensor = torch.linalg.vecdot(a, b)
    return found


def _remaining(done: Tensor, *state: Tensor) -> list[Tensor]:
    """The rows of each tensor that are not ``done`` (B,), in place: the last of them fill the gaps, no others move."""
    count = len(done) - int(done.sum())
    gaps, last = done[:count].nonzero().squeeze(1), count + (~done[count:]).nonzero().squeeze(1)
    for tensor in state:
        tensor[gaps] = tensor[last]
    return [tensor[:count] for tensor in state]


class _Memory:
    """The last ``size`` steps s and gradient changes y of each problem, with the dot products that the recursion reads.

    Holding the dot products lets the two-loop recursion run on 2·size coefficients a problem (Chen et al., NeurIPS
    2014).  Those of a new y are differences of the ones with the gradients before and after (Byrd, Nocedal & Schnabel,
    Math. Program. 63, 1994), so the long vectors are read twice a round: once for the products with the gradient, and
    once to combine them.
    """

    def __init__(self, like: Tensor, size: int) -> None:
        batch, n = like.shape
        self.size = size
        # s in the first half, y in the second; rows of whole cache lines, so that sums do not depend on where they lie
        self.vectors = like.new_zeros(batch, 2 * size, -(-n // LINE) * LINE)
        self.products = like.new_zeros(batch, size, 2 * size)  # of each y with all of them, where s is no newer than y
        self.with_gradient = like.new_zeros(batch, 2 * size)  # products with the last gradient
        self.pairs = torch.zeros(batch, dtype=torch.long, device=like.device)  # stored so far

    def drop(self, done: Tensor) -> None:
        """Keep only the problems that are not ``done`` (B,), in the order of :func:`_remaining`."""
        state = self.vectors, self.products, self.with_gradient, self.pairs
        self.vectors, self.products, self.with_gradient, self.pairs = _remaining(done, *state)

    def forget(self, rows: Tensor) -> None:
        """Empty the memory of the problems ``rows``."""
        self.pairs[rows] = 0

    def update(self, moved: Tensor, s: Tensor, y: Tensor, gradient: Tensor) -> Tensor:
        """Store s and y, over the oldest pair, where the problem ``moved`` (B,); then -H·gradient, all (B, N).

        A pair whose curvature is lost in rounding is not stored.  The two-loop recursion (Nocedal & Wright, algorithm
        7.4), on the coefficients of the stored vectors.
        """
        m, n = self.size, gradient.shape[1]
        before = self.with_gradient
        after = torch.bmm(gradient.unsqueeze(1), self.vectors[..., :n].mT).squeeze(1)
        with_y = after - before
        sy, yy = _dot(s, y), _dot(y, y)
        stored = moved & (sy > torch.finfo(y.dtype).eps * yy)
        new, at = stored.nonzero().squeeze(1), (self.pairs % m)[stored]
        self.vectors[new, at, :n], self.vectors[new, at + m, :n] = s[new], y[new]
        after[new, at], after[new, at + m] = _dot(s, gradient)[new], _dot(y, gradient)[new]
        with_y[new, at], with_y[new, at + m] = sy[new], yy[new]
        self.products[new, at], self.products[new, :, at + m] = with_y[new], with_y[new, m:]
        self.with_gradient = torch.where(moved.unsqueeze(1), after, before)
        self.pairs += stored

        small = (x.cpu().numpy() for x in (self.products, self.with_gradient, self.pairs))
        gamma, coefficients = (torch.from_numpy(x).to(gradient) for x in _two_loops(*small))
        combined = torch.bmm(coefficients.unsqueeze(1), self.vectors).squeeze(1)[:, :n]
        return combined.addcmul_(gamma.unsqueeze(1), gradient).neg_()


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
    value, gradient = (found.clone() for found in objective(x, index))
    result, result_value = x.clone(), value.clone()
    reasons = torch.zeros_like(index)
    evaluations = torch.ones(len(x), dtype=torch.long, device=x.device)
    history = [value.clone()]
    if watch is not None:
        watch(index, evaluations)

    def steepest(gradient: Tensor) -> Tensor:
        norm = gradient.norm(dim=1, keepdim=True)
        return -gradient * torch.where(norm > 0, first_step / norm, 0)

    pairs = _Memory(x, memory)
    direction = steepest(gradient)
    slope = _dot(gradient, direction)
    step = torch.ones_like(value)
    low, high = torch.zeros_like(value), torch.full_like(value, torch.inf)

    for evaluation in range(2, max_evaluations + 1):
        trial = torch.addcmul(x, step.unsqueeze(1), direction)
        trial_value, trial_gradient = objective(trial, index)
        evaluations[index] += 1
        if watch is not None:
            watch(index, evaluations[index])

        enough = trial_value <= value + ARMIJO * step * slope  # False for NaN
        accepted = enough & (_dot(trial_gradient, direction) >= CURVATURE * slope)
        if accepted.any():
            move = accepted.unsqueeze(1)
            s, y = step.unsqueeze(1) * direction, trial_gradient - gradient
            x.addcmul_((accepted * step).unsqueeze(1), direction)  # the trial, or no step at all
            value = torch.where(accepted, trial_value, value)
            gradient = torch.where(move, trial_gradient, gradient)
            turned = pairs.update(accepted, s, y, gradient)
            turned_slope = _dot(gradient, turned)
            uphill = accepted & ~(turned_slope < 0)
            if uphill.any():  # rounding has spoilt the memory
                pairs.forget(uphill)
                turned = torch.where(uphill.unsqueeze(1), steepest(gradient), turned)
                turned_slope = _dot(gradient, turned)
            direction = torch.where(move, turned, direction) if not accepted.all() else turned

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
            reasons[index] = torch.where(flat, 1, torch.where(slow, 2, torch.where(stuck, 3, 0)))
            result[index[done]], result_value[index[done]] = x[done], value[done]
            index, x, value, gradient, direction, slope, step, low, high = _remaining(
                done, index, x, value, gradient, direction, slope, step, low, high
            )
            if not len(index):
                break
            pairs.drop(done)
    result[index], result_value[index] = x, value
    why = [REASONS[reason] for reason in reasons.tolist()]
    return Minimum(result, result_value, evaluations, why, torch.stack(history))
