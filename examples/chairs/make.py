"""Writes the chairs that come with nablahog: those of ``nablahog.sample_chairs``, and those of Table 2's scenes.

``python examples/chairs/make.py`` replaces both files in ``src``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from chairs import chair, library

from nablahog.render.models import save_meshes

PACKAGE = Path(__file__).parents[2] / "src" / "nablahog"
SCENE_CHAIRS = 24  # in the scenes of Table 2

if __name__ == "__main__":
    save_meshes(PACKAGE / "io" / "chairs.npz", library())
    in_scenes = {f"chair-{seed:02d}": chair(seed) for seed in range(SCENE_CHAIRS)}
    save_meshes(PACKAGE / "paper" / "chairs.npz", in_scenes, np.float64)  # figures of Table 2 depend on every bit
