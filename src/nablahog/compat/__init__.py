"""Replacements for the HOGs of other libraries, with their names, arguments and results."""

from ..runtime.lazy import names_when_used
from . import opencv, skimage

__all__ = ["opencv", "skimage"]

names_when_used(__name__)  # for dir() and wrong names
