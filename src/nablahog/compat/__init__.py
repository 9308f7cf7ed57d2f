"""Replacements for the HOGs of other libraries, with their names, arguments and results."""

from . import opencv, skimage

__all__ = ["opencv", "skimage"]
