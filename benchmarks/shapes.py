"""Objects that look alike from several sides, exactly or nearly, for `poses.py` and `calibration.py`:

    python benchmarks/shapes.py DIR

writes them as PLY files, z up, fronts to -y.  A bottle and a round table look the same from everywhere; a box, a
table and a basket after half a turn.  A spray can, a mug, a desk, a basket with a label and a car differ in a detail.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from trimesh import Trimesh
from trimesh.creation import annulus, box, cylinder, revolve, torus

Triple = Sequence[float]
TURNS = {"bottle": 0, "round_table": 0, "box": 2, "table": 2, "basket": 2}
"""Views alike in a full turn, 0 for all; 1 for objects that are not here."""


def at(mesh: Trimesh, place: Triple, gray: float = 0.7) -> Trimesh:
    """A mesh moved to a place and painted."""
    mesh.apply_translation(place)
    mesh.visual.face_colors = np.uint8([255 * gray] * 3 + [255])
    return mesh


def block(size: Triple, place: Triple, gray: float = 0.7) -> Trimesh:
    return at(box(size), place, gray)


def rod(radius: float, height: float, place: Triple, gray: float = 0.7) -> Trimesh:
    return at(cylinder(radius, height, sections=48), place, gray)


def legs(width: float, depth: float, height: float) -> list[Trimesh]:
    return [block((0.06, 0.06, height), (x * width / 2, y * depth / 2, 0)) for x in (-1, 1) for y in (-1, 1)]


def basket() -> list[Trimesh]:
    walls = [block((1.0, 0.04, 0.5), (0, 0.35 * y, 0)) for y in (-1, 1)]
    walls += [block((0.04, 0.7, 0.5), (0.5 * x, 0, 0)) for x in (-1, 1)]
    handle = torus(0.5, 0.03, major_sections=48, minor_sections=12)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    return [*walls, block((1.0, 0.7, 0.04), (0, 0, -0.25)), at(handle, (0, 0, 0.2), 0.5)]


def mug() -> list[Trimesh]:
    handle = torus(0.22, 0.05, major_sections=48, minor_sections=12)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    cup = at(annulus(0.38, 0.42, 0.9, sections=48), (0, 0, 0))
    return [cup, rod(0.4, 0.04, (0, 0, -0.43)), at(handle, (0.5, 0, 0))]


def shapes() -> dict[str, list[Trimesh]]:
    """The parts of each."""
    profile = np.array([(0, 0), (0.2, 0), (0.2, 0.6), (0.07, 0.8), (0.07, 1.0), (0, 1.0)])
    top = (1.4, 0.8, 0.05)
    return {
        "bottle": [at(revolve(profile, sections=48), (0, 0, 0), 0.5)],
        "round_table": [rod(0.6, 0.05, (0, 0, 0.7)), rod(0.06, 0.7, (0, 0, 0.35)), rod(0.35, 0.05, (0, 0, 0))],
        "box": [block((1.0, 0.6, 0.5), (0, 0, 0))],
        "table": [block(top, (0, 0, 0.35)), *legs(1.3, 0.7, 0.7)],
        "basket": basket(),
        "basket_label": [*basket(), block((0.4, 0.02, 0.2), (0, -0.375, 0), 0.15)],
        "spray_can": [
            rod(0.2, 0.8, (0, 0, 0)),
            rod(0.1, 0.1, (0, 0, 0.45), 0.4),
            block((0.06, 0.1, 0.04), (0, -0.12, 0.47), 0.1),
            block((0.2, 0.02, 0.4), (0, -0.2, 0), 0.2),
        ],
        "mug": mug(),
        "desk": [block(top, (0, 0, 0.35)), *legs(1.3, 0.7, 0.7), block((0.4, 0.6, 0.5), (0.45, 0, 0.08), 0.5)],
        "car": [
            block((0.7, 1.7, 0.35), (0, 0, 0)),
            block((0.62, 0.9, 0.3), (0, 0.15, 0.32), 0.3),
            block((0.62, 0.88, 0.02), (0, 0.15, 0.47)),
            *(at(_wheel(), (0.33 * x, 0.55 * y, -0.18), 0.1) for x in (-1, 1) for y in (-1, 1)),
        ],
    }


def _wheel() -> Trimesh:
    wheel = cylinder(0.2, 0.12, sections=32)
    wheel.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    return wheel


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, parts in shapes().items():
        trimesh.util.concatenate(parts).export(folder / f"{name}.ply")


if __name__ == "__main__":
    main()
