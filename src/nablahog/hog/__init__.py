"""Section 2: image to descriptor, differentiable."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
