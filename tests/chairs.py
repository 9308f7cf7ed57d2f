"""Procedural chairs: those in the scenes of Table 2, by the seeds 0 … 23 that they were made of."""

from __future__ import annotations

from nablahog.paper.scenes import CHAIRS
from nablahog.render import Mesh
from nablahog.render.models import load_meshes


def chair(seed: int) -> Mesh:
    return load_meshes(CHAIRS)[f"chair-{seed:02d}"]
