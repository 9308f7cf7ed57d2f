"""Files in and out."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
