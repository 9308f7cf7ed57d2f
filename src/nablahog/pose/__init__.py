"""Section 3.2 of the paper: the pose of an object from the similarity of HOG descriptors."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
