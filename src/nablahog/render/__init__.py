"""The differentiable renderer: a mesh, a pose and a camera to an image (Section 3.2)."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
