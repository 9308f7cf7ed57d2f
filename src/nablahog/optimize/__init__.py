"""Minimisers over batches: each row of the unknowns is a problem of its own, with its own steps and its own stop."""

from .adam import adam
from .choose import Minimiser, minimise
from .dogleg import dogleg
from .lbfgs import lbfgs
from .momentum import momentum
from .result import History, LeastSquares, Minimum, Objective, Watch

__all__ = [
    "History",
    "LeastSquares",
    "Minimiser",
    "Minimum",
    "Objective",
    "Watch",
    "adam",
    "dogleg",
    "lbfgs",
    "minimise",
    "momentum",
]
