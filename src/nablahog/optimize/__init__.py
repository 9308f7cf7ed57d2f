"""Minimisers over batches: each row of the unknowns is a problem of its own, with its own steps and its own stop."""

from collections.abc import Callable
from typing import Literal, TypeAlias

from ..runtime.lazy import names_when_used
from .dogleg import dogleg
from .lbfgs import lbfgs
from .problems import (
    Accepted,
    History,
    Jacobian,
    LeastSquares,
    Linearizable,
    Minimum,
    ObjectiveFunction,
    StopReason,
    Watch,
)

Minimiser: TypeAlias = Literal["lbfgs", "dogleg"]
MINIMISERS: dict[Minimiser, Callable[..., Minimum]] = {"lbfgs": lbfgs, "dogleg": dogleg}

__all__ = [
    "MINIMISERS",
    "Accepted",
    "History",
    "Jacobian",
    "LeastSquares",
    "Linearizable",
    "Minimiser",
    "Minimum",
    "ObjectiveFunction",
    "StopReason",
    "Watch",
    "dogleg",
    "lbfgs",
]

names_when_used(__name__)  # for dir() and wrong names
