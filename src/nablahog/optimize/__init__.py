"""Minimisers over batches: each row of the unknowns is a problem of its own, with its own steps and its own stop."""

from .lbfgs import lbfgs
from .result import Minimum, Objective

__all__ = ["Minimum", "Objective", "lbfgs"]
