"""How far apart the HOGs of libraries are on a photograph, and which of their conventions that is."""

from .compare import Comparison, Pair, compare
from .conventions import Convention
from .shares import Share

__all__ = ["Comparison", "Convention", "Pair", "Share", "compare"]
