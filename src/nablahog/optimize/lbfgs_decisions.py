"""The decisions of L-BFGS, on a few numbers of each problem: whether a trial is accepted, the next step or direction.

The line search is Lewis & Overton's bracketing for the weak Wolfe conditions, which copes with the kinks of piecewise
smooth objectives (Math. Program. 141, 2013).  The direction is a combination of the gradient and of the last m steps s
and gradient changes y, whose coefficients follow from dot products alone (Byrd, Nocedal & Schnabel, Math. Program. 63,
1994).  From the newest to the oldest pair, with U the upper triangle of Y·Sᵀ and D its diagonal,

    H·g = γg + Σ cᵢsᵢ - γ Σ αᵢyᵢ,    Uᵀα = S·g,    U·c = Dα - γ(Y·g - Y·Yᵀα).

A new pair is a new first row and column of U, so U⁻¹ is kept: its other rows stay.  Before there are m pairs all are 0.

All problems do the same operations, of NumPy on a CPU or PyTorch on a device; what a problem does not do is masked.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .problems import Numbers, array_namespace, possibly_any

ARMIJO, CURVATURE = 1e-4, 0.9  # constants of the Wolfe conditions, Nocedal & Wright p. 62
ALONG, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW = range(-4, 0)  # dot products after those with stored vectors


class SearchState(NamedTuple):
    """A few numbers of each running problem, A of them, with m stored pairs, the newest first.

    Attributes:
        values: (A,), the objective at the point.
        steps, lows, highs: (A,), the step to the next trial, and its bracket.
        inverse: (A, m, m), U⁻¹.
        change_products: (A, m, m), Y·Yᵀ.
        curvatures: (A, m), each y with its s.
        with_gradient: (A, 2, m), each s, then each y with the gradient.
    """

    values: Numbers
    steps: Numbers
    lows: Numbers
    highs: Numbers
    inverse: Numbers
    change_products: Numbers
    curvatures: Numbers
    with_gradient: Numbers

    @classmethod
    def from_values(cls, values: Numbers, memory: int) -> SearchState:
        """The state at the start, with values (A,).  There are no pairs: rows and columns of U⁻¹ are 0, and γ is 1."""
        stack, zeros = array_namespace(values).stack, array_namespace(values).zeros_like(values)
        row = stack([zeros] * memory, 1)
        square = stack([row] * memory, 1)
        return cls(values, zeros + 1, zeros, zeros + math.inf, square, square + 1, row + 1, stack([row] * 2, 1))

    def without_pairs(self, which: Numbers) -> SearchState:
        """The problems ``which`` (A,) have none any more."""
        where, which = array_namespace(which).where, which[:, None]
        return self._replace(
            inverse=where(which[:, None], 0, self.inverse),
            change_products=where(which[:, None], 1, self.change_products),
            curvatures=where(which, 1, self.curvatures),
        )

    def where(self, mask: Numbers, other: SearchState) -> SearchState:
        """These where ``mask`` (A,) holds, elsewhere ``other``."""
        where, masks = array_namespace(mask).where, [mask, mask[:, None], mask[:, None, None]]
        return SearchState(*(where(masks[own.ndim - 1], own, its) for own, its in zip(self, other, strict=True)))


class Decisions(NamedTuple):
    """What each of A problems does next; one that has ended does nothing.

    Attributes:
        steps: (A,), the step by which it moves on to its trial point, or 0.
        stays: (A,), whether it tries another step instead.
        stores: (A,), whether s and y of its step are to be stored: not where their curvature is lost in rounding.
        coefficients: (A, 2m + 1) of its new direction, if it moves: of each s, of each y, and of the gradient.
    """

    steps: Numbers
    stays: Numbers
    stores: Numbers
    coefficients: Numbers


@np.errstate(all="ignore")  # what is masked may be not finite
def decide(
    state: SearchState, running: Numbers, slopes: Numbers, trial_values: Numbers, dots: Numbers
) -> tuple[SearchState, Decisions]:
    """For each problem, whether it moves on to its trial point, and its next direction or step.

    Args:
        state: of the last trial.
        running: (A,), which problems have not ended.
        slopes, trial_values: (A,), the objective's slope along the direction, and its value at the trial point.
        dots: (A, 2m + 4): of the gradient there with each stored s, then y, and with the direction, and of its change
            with the direction, with itself, and with the gradient.
    """
    sufficient = trial_values <= state.values + ARMIJO * state.steps * slopes  # False for NaN
    moves = sufficient & (dots[:, ALONG] >= CURVATURE * slopes) & running
    stays, steps = ~moves & running, state.steps
    moved, stores = _move(state, moves, trial_values, dots)
    coefficients = _direction(moved)
    if possibly_any(~moves):
        moved = moved.where(moves, _next_trial(state, stays, sufficient, slopes, trial_values))
        steps = array_namespace(dots).where(moves, steps, 0)
    return moved, Decisions(steps, stays, stores, coefficients)


def _next_trial(
    state: SearchState, stays: Numbers, sufficient: Numbers, slopes: Numbers, trial_values: Numbers
) -> SearchState:
    """The state with the next step of those that stay; the last was too short if ``sufficient``, else too long."""
    xp, steps = array_namespace(slopes), state.steps
    lows, highs = xp.where(sufficient, steps, state.lows), xp.where(sufficient, state.highs, steps)
    # the minimum of the parabola through both values and the slope; in a bracket bounded from below, its middle
    guess = -slopes * steps * steps / (2 * (trial_values - state.values - steps * slopes))
    guess = xp.where(lows != 0, lows + (highs - lows) / 2, guess)
    tenth = (highs - lows) / 10
    least = lows + tenth
    within = xp.where(guess > least, xp.minimum(guess, highs - tenth), least)  # the parabola may be none
    return state._replace(
        steps=xp.where(stays, xp.where(highs == math.inf, 2 * steps, within), steps),
        lows=xp.where(stays, lows, state.lows),
        highs=xp.where(stays, highs, state.highs),
    )


def _move(state: SearchState, moves: Numbers, trial_values: Numbers, dots: Numbers) -> tuple[SearchState, Numbers]:
    """As if all moved to their trial points; and whether each pair is stored, (A,)."""
    xp, m, steps = array_namespace(dots), state.curvatures.shape[1], state.steps
    s_y, y_y = steps * dots[:, CHANGE_ALONG], dots[:, CHANGE_SQUARED]
    stores = moves & (s_y > xp.finfo(dots.dtype).eps * y_y)
    old_with_gradient = dots[:, : 2 * m].reshape(state.with_gradient.shape)
    old_with_change = old_with_gradient - state.with_gradient
    inverse, change_products, curvatures, with_gradient = (xp.empty_like(numbers) for numbers in state[4:])
    # the new row of U is [sᵀy, r], that of its inverse [1, -r·U⁻¹] / sᵀy
    inverse[:, 0, 0], inverse[:, 1:, 0] = 1 / s_y, 0
    inverse[:, 0, 1:] = (old_with_change[:, :1] @ state.inverse)[:, 0, :-1] / -s_y[:, None]
    inverse[:, 1:, 1:] = state.inverse[:, :-1, :-1]
    change_products[:, 0, 0] = y_y
    change_products[:, 0, 1:] = change_products[:, 1:, 0] = old_with_change[:, 1, :-1]
    change_products[:, 1:, 1:] = state.change_products[:, :-1, :-1]
    curvatures[:, 0], curvatures[:, 1:] = s_y, state.curvatures[:, :-1]
    with_gradient[:, 0, 0], with_gradient[:, 1, 0] = steps * dots[:, ALONG], dots[:, CHANGE_WITH_NEW]
    with_gradient[:, :, 1:] = old_with_gradient[:, :, :-1]
    zeros = xp.zeros_like(steps)
    moved = SearchState(
        trial_values, zeros + 1, zeros, zeros + math.inf, inverse, change_products, curvatures, with_gradient
    )
    if possibly_any(~stores):
        moved = moved.where(stores, SearchState(*moved[:4], *state[4:-1], old_with_gradient))
    return moved, stores


def _direction(state: SearchState) -> Numbers:
    """The coefficients (A, 2m + 1) of -H·g: of each s, of each y, and of the gradient."""
    gamma = state.curvatures[:, :1] / state.change_products[:, :1, 0]
    alphas = state.with_gradient[:, :1] @ state.inverse  # (A, 1, m)
    change_coefficients = gamma * (state.with_gradient[:, 1:] - alphas @ state.change_products)[:, 0]
    alphas = alphas[:, 0]
    step_coefficients = state.inverse @ (state.curvatures * alphas - change_coefficients)[:, :, None]
    return array_namespace(gamma).concatenate([-step_coefficients[:, :, 0], gamma * alphas, -gamma], 1)
