"""Data sets: PASCAL VOC and PASCAL3D+ as published, lists of objects, CAD models, procedural chairs, scenes of them."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from . import annotations, cad, chairs, pascal3d, scenes, viewpoints, voc

__all__ = ["annotations", "cad", "chairs", "pascal3d", "scenes", "viewpoints", "voc"]

names_when_used(__name__)
