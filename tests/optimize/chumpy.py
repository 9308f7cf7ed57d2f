"""Chumpy's dogleg with dense matrices, by its rules as described: the reference for ours."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def dogleg(
    residuals: Callable[[Vector], Vector],
    jacobian: Callable[[Vector], Vector],
    p: Vector,
    iterations: int,
    radius: float | None = None,
    e_1: float = 1e-15,
    e_2: float = 1e-15,
) -> tuple[list[Vector], list[bool]]:
    """All points tried, and whether each was accepted."""
    tried: list[Vector] = []
    accepted: list[bool] = []
    delta = radius
    r, J = residuals(p), jacobian(p)
    g = -J.T @ r
    for _ in range(iterations):
        if np.abs(g).max() < e_1:
            break
        cauchy = (g @ g) / np.sum((J @ g) ** 2) * g
        newton: Vector | None = None
        while True:
            if delta is not None and np.linalg.norm(cauchy) >= delta:
                step = delta / np.linalg.norm(cauchy) * cauchy
            else:
                if newton is None:
                    newton = np.linalg.lstsq(J, -r, rcond=1e-10)[0]
                if delta is None or np.linalg.norm(newton) <= delta:
                    step = newton
                    delta = float(np.linalg.norm(newton)) if delta is None else delta
                else:  # the textbook root of |cauchy + t (newton - cauchy)|² = delta²
                    leg = newton - cauchy
                    a, b, c = leg @ leg, 2 * cauchy @ leg, cauchy @ cauchy - delta**2
                    step = cauchy + (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a) * leg
            length = float(np.linalg.norm(step))
            if length <= e_2 * np.linalg.norm(p):
                return tried, accepted
            with np.errstate(all="ignore"):
                r_new = residuals(p + step)
                gain = (r @ r - r_new @ r_new) / (2 * g @ step - np.sum((J @ step) ** 2))
            tried.append(p + step)
            accepted.append(bool(gain > 0))
            if gain > 0:
                p, r = p + step, r_new
                J = jacobian(p)
                g = -J.T @ r
            if gain > 0.9:
                delta = max(delta, 2.5 * length)
            elif not gain >= 0.05:
                delta *= 0.25
            if delta <= e_2 * np.linalg.norm(p):
                return tried, accepted
            if accepted[-1]:
                break
    return tried, accepted
