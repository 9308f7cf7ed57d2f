"""Objects that look alike from several sides, exactly or nearly, and other classes than chairs, for `confidence.py`:

    python benchmarks/shapes.py DIR [--variants N]

writes them as PLY files, z up, fronts to -y; with --variants, DIR/NAME/0.ply … of each shape, of random proportions.
A bottle and a round table look the same from everywhere; a box, a table and a basket after half a turn.  A spray can, a
mug, a desk, a basket with a label and a car differ in a detail.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import trimesh
from trimesh import Trimesh
from trimesh.creation import annulus, box, cylinder, revolve, torus
from trimesh.visual import ColorVisuals

Triple: TypeAlias = Sequence[float]
Vary: TypeAlias = Callable[[float], float]  # a length, perhaps another one


def at(mesh: Trimesh, place: Triple, gray: float = 0.7) -> Trimesh:
    """A mesh moved to a place and painted."""
    mesh.apply_translation(place)
    level = int(255 * gray)
    mesh.visual = ColorVisuals(mesh, face_colors=[level, level, level, 255])
    return mesh


def turned(mesh: Trimesh, axis: Triple) -> Trimesh:
    """A mesh after a quarter turn."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, axis))
    return mesh


def block(size: Triple, place: Triple, gray: float = 0.7) -> Trimesh:
    return at(box(size), place, gray)


def rod(radius: float, height: float, place: Triple, gray: float = 0.7) -> Trimesh:
    return at(cylinder(radius, height, sections=48), place, gray)


def handle(radius: float, thickness: float, place: Triple) -> Trimesh:
    return at(turned(torus(radius, thickness, major_sections=48, minor_sections=12), (1, 0, 0)), place, 0.5)


def bottle(vary: Vary) -> list[Trimesh]:
    wide, narrow, shoulder = vary(0.2), vary(0.07), vary(0.6)
    profile = [
        (0, 0),
        (wide, 0),
        (wide, shoulder),
        (narrow, shoulder + 0.2),
        (narrow, shoulder + 0.4),
        (0, shoulder + 0.4),
    ]
    return [at(revolve(np.array(profile), sections=48), (0, 0, 0), 0.5)]


def round_table(vary: Vary) -> list[Trimesh]:
    height = vary(0.7)
    return [
        rod(vary(0.6), 0.05, (0, 0, height)),
        rod(0.06, height, (0, 0, height / 2)),
        rod(vary(0.35), 0.05, (0, 0, 0)),
    ]


def crate(vary: Vary) -> list[Trimesh]:
    return [block((vary(1.0), vary(0.6), vary(0.5)), (0, 0, 0))]


def table(vary: Vary) -> list[Trimesh]:
    width, depth, height = vary(1.4), vary(0.8), vary(0.7)
    x, y = width / 2 - 0.05, depth / 2 - 0.05
    legs = [block((0.06, 0.06, height), (i * x, j * y, 0)) for i in (-1, 1) for j in (-1, 1)]
    return [block((width, depth, 0.05), (0, 0, height / 2)), *legs]


def desk(vary: Vary) -> list[Trimesh]:
    return [*table(vary), block((vary(0.4), 0.6, vary(0.5)), (0.42, 0, 0.08), 0.5)]


def basket(vary: Vary) -> list[Trimesh]:
    width, depth, height = vary(1.0), vary(0.7), vary(0.5)
    walls = [block((width, 0.04, height), (0, y * depth / 2, 0)) for y in (-1, 1)]
    walls += [block((0.04, depth, height), (x * width / 2, 0, 0)) for x in (-1, 1)]
    bottom = block((width, depth, 0.04), (0, 0, -height / 2))
    return [*walls, bottom, handle(width / 2, 0.03, (0, 0, 0.2))]


def labelled_basket(vary: Vary) -> list[Trimesh]:
    parts = basket(vary)
    front = min(part.bounds[0, 1] for part in parts)
    return [*parts, block((0.4, 0.02, 0.2), (0, front, 0), 0.15)]


def spray_can(vary: Vary) -> list[Trimesh]:
    radius, height = vary(0.2), vary(0.8)
    return [
        rod(radius, height, (0, 0, 0)),
        rod(radius / 2, 0.1, (0, 0, height / 2 + 0.05), 0.4),
        block((0.06, 0.1, 0.04), (0, -0.6 * radius, height / 2 + 0.07), 0.1),
        block((radius, 0.02, height / 2), (0, -radius, 0), 0.2),
    ]


def mug(vary: Vary) -> list[Trimesh]:
    radius, height = vary(0.4), vary(0.9)
    cup = at(annulus(radius - 0.02, radius + 0.02, height, sections=48), (0, 0, 0))
    return [cup, rod(radius, 0.04, (0, 0, 0.02 - height / 2)), handle(vary(0.22), 0.05, (radius + 0.1, 0, 0))]


def car(vary: Vary) -> list[Trimesh]:
    width, length, height, cabin, back = vary(0.7), vary(1.7), vary(0.35), vary(0.9), vary(0.15)
    top, roof = height / 2 + 0.15, height / 2 + 0.3
    wheels = [(x * (width / 2 - 0.02), 0.32 * y * length, -height / 2) for x in (-1, 1) for y in (-1, 1)]
    return [
        block((width, length, height), (0, 0, 0)),
        block((0.9 * width, cabin, 0.3), (0, back, top), 0.3),
        block((0.9 * width, cabin, 0.02), (0, back, roof)),
        *(at(turned(cylinder(0.2, 0.12, sections=32), (0, 1, 0)), place, 0.1) for place in wheels),
    ]


def sofa(vary: Vary) -> list[Trimesh]:
    width, depth, back = vary(1.6), vary(0.7), vary(0.5)
    arms = [block((0.18, depth, 0.35), (x * width / 2, 0, 0.2)) for x in (-1, 1)]
    return [block((width, depth, 0.4), (0, 0, 0)), block((width, 0.2, back), (0, depth / 2, back / 2 + 0.1)), *arms]


SHAPES: Mapping[str, Callable[[Vary], list[Trimesh]]] = {
    "bottle": bottle,
    "round_table": round_table,
    "box": crate,
    "table": table,
    "basket": basket,
    "basket_label": labelled_basket,
    "spray_can": spray_can,
    "mug": mug,
    "desk": desk,
    "car": car,
    "sofa": sofa,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--variants", type=int, default=0, help="of each shape, in a folder of its own")
    options = parser.parse_args()
    generator = np.random.default_rng(0)
    for name, parts in SHAPES.items():
        if not options.variants:
            options.folder.mkdir(parents=True, exist_ok=True)
            trimesh.util.concatenate(parts(float)).export(options.folder / f"{name}.ply")
        for number in range(options.variants):
            folder = options.folder / name
            folder.mkdir(parents=True, exist_ok=True)
            varied = parts(lambda length: float(length * generator.uniform(0.75, 1.3)))
            trimesh.util.concatenate(varied).export(folder / f"{number}.ply")


if __name__ == "__main__":
    main()
