"""Data sets: PASCAL VOC and PASCAL3D+ as published, folders of CAD models, procedural chairs, synthetic scenes."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from . import cad, chairs, pascal3d, scenes, viewpoints, voc

__all__ = ["cad", "chairs", "pascal3d", "scenes", "viewpoints", "voc"]

names_when_used(__name__)
