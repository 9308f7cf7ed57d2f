"""Minimisers over batches: each row of the unknowns is a problem of its own, with its own steps and its own stop."""

from .dogleg import dogleg
from .lbfgs import lbfgs
from .minimisers import Minimiser, minimise
from .result import (
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

__all__ = [
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
    "minimise",
]
