"""Distances between the HOGs of libraries on a photograph, and the contribution of each convention to them."""

from .compare import Comparison, Pair, compare
from .conventions import Convention
from .shapley import ShapleyContribution

__all__ = ["Comparison", "Convention", "Pair", "ShapleyContribution", "compare"]
