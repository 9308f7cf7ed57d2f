"""Pictures and pages."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .pictures import glyphs

__all__ = ["glyphs"]

names_when_used(__name__, pictures=("glyphs",))
