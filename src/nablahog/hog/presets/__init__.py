"""The dialects by name: each is one HOGSpec with its source."""

from ...runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
