"""The decisions of :mod:`.lbfgs_decisions` for all problems at once, by operations of PyTorch that wait for no device.

The same rules and, up to rounding, the same numbers; what a problem does not do is masked.  The two loops over the
stored pairs are two triangular systems: with Y·Sᵀ of the pairs from the newest to the oldest, its upper triangle U and
diagonal D, H·g = γg + Σ cᵢsᵢ - γ Σ αᵢyᵢ, where Uᵀα = S·g and U·c = Dα - γ(Y·g - Y·Yᵀα) (Byrd, Nocedal & Schnabel, Math.
Program. 63, 1994).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .lbfgs_decisions import ALONG, ARMIJO, BESIDE, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW, CURVATURE
from .lbfgs_state import SearchState


class Decisions(NamedTuple):
    """What each of A problems does; one that has ended does nothing.

    Attributes:
        moves: (A,), whether it moves on to its trial point.
        stays: (A,), whether it tries another step instead.
        stores: (A,), whether s and y of its step are to be stored.
        places: (A,) int64, where; of those that do not store, anything.
        coefficients: (A, 2m + 1) of its new direction, if it moves: of the stored vectors, and of the gradient.
    """

    moves: Tensor
    stays: Tensor
    stores: Tensor
    places: Tensor
    coefficients: Tensor


def decide(state: SearchState, running: Tensor, trial_values: Tensor, dots: Tensor) -> tuple[SearchState, Decisions]:
    """As :func:`.lbfgs_decisions.decide`; ``running`` (A,) are the problems that have not ended.

    Returns:
        The state of the next trial, whose slopes and peaks are as before; and the decisions.
    """
    along = dots.shape[1] - BESIDE
    step, slope = state.steps, state.slopes
    enough = trial_values <= state.values + ARMIJO * step * slope  # False for NaN
    accepted = enough & (dots[:, along + ALONG] >= CURVATURE * slope)
    moves, stays = accepted & running, ~accepted & running
    state, stores, places = _remember(state, dots, moves)
    steps, lows, highs = _next_trial(state, trial_values, enough)
    return (
        state._replace(
            values=torch.where(moves, trial_values, state.values),
            steps=torch.where(moves, 1, torch.where(stays, steps, step)),
            lows=torch.where(moves, 0, torch.where(stays, lows, state.lows)),
            highs=torch.where(moves, torch.inf, torch.where(stays, highs, state.highs)),
        ),
        Decisions(moves, stays, stores, places, _direction(state)),
    )


def _next_trial(state: SearchState, trial_values: Tensor, enough: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The next step and its bracket, (A,) each, where the last step is not taken: too short if ``enough``, or long."""
    step, slope = state.steps, state.slopes
    lows, highs = torch.where(enough, step, state.lows), torch.where(enough, state.highs, step)
    # the minimum of the parabola through both values and the slope
    guess = -slope * step * step / (2 * (trial_values - state.values - step * slope))
    guess = torch.where(lows != 0, lows + (highs - lows) / 2, guess)
    tenth = (highs - lows) / 10
    least = lows + tenth
    within = torch.where(guess > least, torch.minimum(guess, highs - tenth), least)  # the parabola may be none
    return torch.where(highs == torch.inf, 2 * step, within), lows, highs


def _remember(state: SearchState, dots: Tensor, moves: Tensor) -> tuple[SearchState, Tensor, Tensor]:
    """Enters the products of a new s and y, over the oldest pair's, of those that move.

    Returns:
        The state with them; whether each problem's pair is stored, (A,): not where its curvature is lost in rounding;
        and its place, (A,).
    """
    m, both = state.products.shape[1:]
    sy, yy = state.steps * dots[:, both + CHANGE_ALONG], dots[:, both + CHANGE_SQUARED]
    stores = moves & (sy > torch.finfo(dots.dtype).eps * yy)
    places = state.pairs % m
    slots = torch.arange(m, device=dots.device)
    new = (slots == places.unsqueeze(1)) & stores.unsqueeze(1)
    of_y = dots[:, :both] - state.with_gradient  # of y with each stored vector
    products = torch.where(new.unsqueeze(2), of_y.unsqueeze(1), state.products)
    by_s, by_y = products[..., :m], products[..., m:]
    by_y = torch.where(new.unsqueeze(1), of_y[:, m:].unsqueeze(2), by_y)  # of each stored y with y
    own = new.unsqueeze(1) & new.unsqueeze(2)
    by_s, by_y = (torch.where(own, p.view(-1, 1, 1), by) for p, by in ((sy, by_s), (yy, by_y)))
    s_new, y_new = state.steps * dots[:, both + ALONG], dots[:, both + CHANGE_WITH_NEW]
    with_new = torch.cat(
        [
            torch.where(new, s_new.unsqueeze(1), dots[:, :m]),
            torch.where(new, y_new.unsqueeze(1), dots[:, m:both]),
        ],
        dim=1,
    )
    state = state._replace(
        products=torch.cat([by_s, by_y], dim=2),
        with_gradient=torch.where(moves.unsqueeze(1), with_new, state.with_gradient),
        pairs=state.pairs + stores,
    )
    return state, stores, places


def _direction(state: SearchState) -> Tensor:
    """The coefficients (A, 2m + 1) of -H·gradient: of the stored vectors, and of the gradient."""
    m = state.products.shape[1]
    ages = torch.arange(m, device=state.pairs.device)
    at = (state.pairs.unsqueeze(1) - 1 - ages) % m  # from the newest to the oldest
    stored = ages < state.pairs.unsqueeze(1)
    both = stored.unsqueeze(1) & stored.unsqueeze(2)
    rows = state.products.gather(1, at.unsqueeze(2).expand(-1, -1, 2 * m))
    columns = at.unsqueeze(1).expand(-1, m, -1)
    ys, yy = rows.gather(2, columns).masked_fill(~both, 0).triu(), rows.gather(2, columns + m).masked_fill(~both, 0)
    g_s, g_y = (state.with_gradient.gather(1, at + k).masked_fill(~stored, 0) for k in (0, m))
    diagonal = ys.diagonal(dim1=1, dim2=2)
    gamma = torch.where(stored[:, :1], diagonal[:, :1] / yy[:, 0, :1], 1)
    upper = ys + torch.diag_embed((~stored).to(ys))
    alphas = torch.linalg.solve_triangular(upper.mT, g_s.unsqueeze(2), upper=False)
    of_y = gamma * (g_y - (yy @ alphas).squeeze(2))
    of_s = torch.linalg.solve_triangular(upper, (diagonal * alphas.squeeze(2) - of_y).unsqueeze(2), upper=True)
    out = torch.zeros_like(state.with_gradient)
    out = out.scatter(1, at, of_s.squeeze(2)).scatter(1, at + m, -gamma * alphas.squeeze(2))
    return -torch.cat([out, gamma], dim=1)
