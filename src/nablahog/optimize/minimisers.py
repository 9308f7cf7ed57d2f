"""The minimisers by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

from torch import Tensor

from .dogleg import dogleg
from .lbfgs import lbfgs
from .result import LeastSquares, Minimum, ObjectiveFunction

Minimiser: TypeAlias = Literal["lbfgs", "dogleg"]
MINIMISERS: dict[str, Callable[..., Minimum]] = {"lbfgs": lbfgs, "dogleg": dogleg}


def minimise(
    name: Minimiser,
    problem: ObjectiveFunction | LeastSquares,
    start: Tensor,
    *,
    max_evaluations: int = 300,
    **options: Any,
) -> Minimum:
    """Minimises a batch of problems by the method called ``name``.

    Args:
        name: ``"lbfgs"``, or ``"dogleg"``, for which the problem must be a :class:`LeastSquares`.
        problem: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        max_evaluations: budget of each problem.
        options: the method's own, see the function of its name.

    Returns:
        For each problem the lowest point found, never worse than its start.

    Raises:
        ValueError: there is no method of that name.
        TypeError: the method has no such option, or the problem has no residuals and the method needs them.
    """
    if name not in MINIMISERS:
        raise ValueError(f"minimiser must be one of {', '.join(map(repr, MINIMISERS))}, got {name!r}")
    return MINIMISERS[name](problem, start, max_evaluations=max_evaluations, **options)
