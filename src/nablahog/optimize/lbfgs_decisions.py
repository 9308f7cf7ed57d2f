"""The decisions of L-BFGS, on a few numbers of each problem: whether a trial is accepted, the next step or direction.

The line search is Lewis & Overton's bracketing for the weak Wolfe conditions, which copes with the kinks of piecewise
smooth objectives (Math. Program. 141, 2013).  The direction is a combination of the gradient and of the last m steps s
and gradient changes y, whose coefficients follow from dot products alone (Chen et al., NeurIPS 2014).  Those of a new y
are differences of the ones with the gradients before and after (Byrd, Nocedal & Schnabel, Math. Program. 63, 1994).
"""

from __future__ import annotations

from ..runtime.arrays import Floats, Integers, Real
from ..runtime.compile import compiled, inlined

ARMIJO, CURVATURE = 1e-4, 0.9  # constants of the Wolfe conditions, Nocedal & Wright p. 62
ALONG, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW = range(4)  # dot products beside those with stored vectors
BESIDE = 4


@inlined
def _remember(
    products: Floats, with_gradient: Floats, dots: Floats, pairs: int, step: Real, tiny: Real, along: int
) -> tuple[int, int]:
    """Enters the dot products of a new s and y, over the oldest pair's; returns its place and the pairs stored.

    A pair whose curvature is lost in rounding is not stored: its place is -1.
    """
    both = len(with_gradient)
    m = both // 2
    sy, yy = step * dots[along + CHANGE_ALONG], dots[along + CHANGE_SQUARED]
    at = -1
    if sy > tiny * yy:
        at = pairs % m
        for k in range(m):  # of y with each s, and of each y with y
            products[at, k] = dots[k] - with_gradient[k]
            products[at, k + m] = dots[k + m] - with_gradient[k + m]
            products[k, at + m] = products[at, k + m]
        products[at, at], products[at, at + m] = sy, yy
        pairs += 1
    for k in range(both):
        with_gradient[k] = dots[k]
    if at >= 0:
        with_gradient[at], with_gradient[at + m] = step * dots[along + ALONG], dots[along + CHANGE_WITH_NEW]
    return at, pairs


@inlined
def _two_loops(products: Floats, gradient: Floats, pairs: int, coefficients: Floats, alphas: Floats) -> Real:
    """H·gradient = γ·gradient + Σ coefficient·vector (Nocedal & Wright, algorithm 7.4): γ, and the coefficients (2m,).

    Args:
        products: (m, 2m), of each stored y with all stored vectors, first s, then y; of an s only where it is no newer.
        gradient: (2m,), their products with the gradient.
        pairs: stored so far.
    """
    both = len(coefficients)
    m = both // 2
    stored = min(m, pairs)
    coefficients[:] = 0
    gamma: Real = gradient[0] - gradient[0] + 1
    for age in range(1, stored + 1):
        at = (pairs - age) % m
        alpha = gradient[at]
        for newer in range(1, age):
            k = (pairs - newer) % m
            alpha += products[k, at] * coefficients[k + m]
        alphas[at] = alpha / products[at, at]
        coefficients[at + m] -= alphas[at]
    if stored > 0:
        at = (pairs - 1) % m
        gamma = products[at, at] / products[at, at + m]
    for k in range(both):
        coefficients[k] *= gamma
    for age in range(stored, 0, -1):
        at = (pairs - age) % m
        beta = gamma * gradient[at + m]
        for k in range(both):  # those of newer steps are still 0
            beta += products[at, k] * coefficients[k]
        coefficients[at] += alphas[at] - beta / products[at, at]
    return gamma


@inlined
def _between(low: Real, high: Real, guess: Real) -> Real:
    """The next step in a bracket: where a parabola has its minimum, or, of one bounded from below, its middle."""
    tenth: Real = (high - low) / 10
    if low != 0:
        guess = low + (high - low) / 2
    least: Real = low + tenth
    if not guess > least:  # or the parabola is none
        return least
    return min(guess, high - tenth)


@compiled
def decide(
    trial_values: Floats,
    dots: Floats,
    tiny: Real,
    values: Floats,
    slopes: Floats,
    steps: Floats,
    lows: Floats,
    highs: Floats,
    pairs: Integers,
    products: Floats,
    with_gradient: Floats,
    taken: Floats,
    places: Integers,
    coefficients: Floats,
) -> None:
    """For each problem, whether it moves on to its trial point, and its next direction or step.

    Args:
        trial_values: (B,), the objective at the trial points.
        dots: (B, 2m + 4): of the gradient there with the stored vectors (B, 2m) and the direction, and of its change
            with the direction, with itself, and with the gradient.
        tiny: curvature, as a share of ‖y‖², that is rounding.
        values, slopes, steps, lows, highs: (B,), the objective at the point and its slope along the direction; the
            step to the trial; the bracket.  All but the slopes are set anew.
        pairs, products, with_gradient: (B,), (B, m, 2m), (B, 2m), of :func:`_two_loops`; set anew where it moves.
        taken: (B,), set to the step of those that move; 0 of those that stay.
        places: (B,), set to where s and y are to be stored; -1 where not.
        coefficients: (B, 2m + 1), those of -H·gradient where it moves: of the stored vectors, and of the gradient.
    """
    along = dots.shape[1] - BESIDE
    alphas = trial_values.repeat(along)
    for i in range(len(values)):
        step, slope = steps[i], slopes[i]
        enough = trial_values[i] <= values[i] + trial_values.dtype.type(ARMIJO) * step * slope  # False for NaN
        taken[i], places[i] = 0, -1
        if enough and dots[i, along + ALONG] >= trial_values.dtype.type(CURVATURE) * slope:
            taken[i], steps[i], lows[i], highs[i] = step, 1, 0, float("inf")
            values[i] = trial_values[i]
            places[i], pairs[i] = _remember(products[i], with_gradient[i], dots[i], pairs[i], step, tiny, along)
            gamma = _two_loops(products[i], with_gradient[i], pairs[i], coefficients[i, :along], alphas)
            coefficients[i, along] = gamma
            for k in range(along + 1):
                coefficients[i, k] = -coefficients[i, k]
        elif enough:  # too short
            lows[i] = step
            unbounded = highs[i] == float("inf")
            steps[i] = 2 * step if unbounded else _between(step, highs[i], step)
        else:  # too long
            highs[i] = step
            # the minimum of the parabola through both values and the slope
            parabola = -slope * step * step / (2 * (trial_values[i] - values[i] - step * slope))
            steps[i] = _between(lows[i], step, parabola)
