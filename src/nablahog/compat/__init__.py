"""Functions with the names, arguments and results of other libraries, to put in their place."""

from . import opencv, skimage

__all__ = ["opencv", "skimage"]
