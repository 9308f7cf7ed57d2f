"""Replacements for the HOGs of other libraries, with their names, arguments and results."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
