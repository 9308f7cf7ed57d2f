"""Minimisers over batches: each row of the unknowns is a problem of its own, with its own steps and its own stop."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
