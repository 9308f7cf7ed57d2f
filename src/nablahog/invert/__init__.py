"""Section 3.1: descriptor to pre-image."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
