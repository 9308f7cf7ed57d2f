"""The normalisers of all dialects, each with its constants and all that follows from them: see :class:`Normalizer`."""

from ...runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
for _name in __all__:
    __getattr__(_name)  # the class of a normaliser registers itself
