"""Data sets: PASCAL VOC and PASCAL3D+ as published, photographs of objects, CAD models, procedural chairs, scenes."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from . import annotations, cad, chairs, conditions, object_lists, pascal3d, scenes, viewpoints, voc

__all__ = ["annotations", "cad", "chairs", "conditions", "object_lists", "pascal3d", "scenes", "viewpoints", "voc"]

names_when_used(__name__)
