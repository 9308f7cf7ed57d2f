"""Scenes of procedural chairs from all around: what a network learns viewpoints from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..io.images import Picture
from ..render import Mesh
from .chairs import KINDS, chair
from .scenes import Scene, SceneSettings, scene

CHAIRS = 1000
_FIRST_SEED = 10_000  # far from the seeds that other scenes and the library of chairs take
_WITH_FRONT = [kind for kind in KINDS if kind != "stool"]  # a stool looks the same from several sides
_SETTINGS = SceneSettings(size=160, height=(72.0, 132.0))  # of which small photographs are not enlarged much


@lru_cache(maxsize=1)
def viewpoint_chairs() -> dict[str, Mesh]:
    """:data:`CHAIRS` procedural chairs by name, half of them of kinds in turn, the others of random kinds."""
    kinds = [kind for each in _WITH_FRONT for kind in (each, None)]
    return {f"{k:04d}": chair(_FIRST_SEED + k, kinds[k % len(kinds)]) for k in range(CHAIRS)}


def viewpoint_scene(index: int, models: Mapping[str, Mesh], photographs: Sequence[Picture], *, seed: int = 0) -> Scene:
    """The scene number ``index``: azimuths are uniform, elevations and tilts mostly those that photographs have.

    A quarter of the scenes have boxes that are off by a tenth of their sides, a quarter shadows and highlights, and a
    quarter the traces of JPEG.

    Args:
        index: at least 0; the same number is the same scene.
        models: objects by name.
        photographs: clutter, as :func:`.scenes.scene` takes it.
        seed: at least 0.

    Raises:
        ValueError: there are no models or photographs, or they have other shapes.

    >>> from nablahog.paper import chairs, viewpoint_scenes
    >>> models = {"a": chairs.chair(1)}
    >>> one = viewpoint_scenes.viewpoint_scene(0, models, [torch.rand(160, 160)])
    >>> one.image.shape
    torch.Size([3, 160, 160])
    """
    generator = np.random.default_rng([seed, index, 3])
    usual, level = generator.random(2) < (0.7, 0.85)
    elevation = generator.triangular(0, 15, 45) if usual else generator.uniform(-20, 80)
    theta = generator.normal(0, 3) if level else generator.uniform(-45, 45)
    rough, lit, compressed = generator.random(3) < 0.25
    settings = replace(
        _SETTINGS,
        box_jitter=0.1 if rough else _SETTINGS.box_jitter,
        shadow=0.9 if lit else 0.0,
        gloss=generator.uniform(0, 0.6) if lit else 0.0,
        jpeg=(20.0, 80.0) if compressed else (0.0, 0.0),
    )
    viewpoint = np.array([[generator.uniform(0, 360), elevation, theta]])
    return scene(index, models, viewpoint, photographs, seed=seed, settings=settings)
