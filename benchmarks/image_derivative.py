"""Is the derivative of a rendering the right one for a search?  By azimuth, against a 16×-supersampled rendering.

    python benchmarks/image_derivative.py [--models DIR] [--chairs 10] [--descriptor paper] [--check 2]

The similarity of a picture to a target is the dot product of their descriptors.  The target is the chair at some
azimuth, before clutter, under another light, with noise.  At 72 azimuths, the derivative of the similarity, which is
that of the descriptor times that of the rendering, is compared with a central difference over ±0.1° of the similarity
of a rendering with 16×16 samples a pixel, whose own derivative plays no part.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from nablahog.hog import HOGSpec, hog, presets
from nablahog.paper.cad import read_models
from nablahog.paper.chairs import chair
from nablahog.render import Camera, Light, Mesh, Renderer, load_mesh, pose
from nablahog.render.renderer import Method
from photographs import SIDE, sample_photographs

Preset: TypeAlias = Callable[..., HOGSpec]
DESCRIPTORS: dict[str, Preset] = {
    "paper": presets.paper,
    "uoctti": presets.uoctti,
    "aubry": presets.aubry,
}
CAMERA = Camera(330, SIDE, SIDE)  # the chair, at three of its diagonals, is some 100 pixels high
ELEVATION, DISTANCE = 20.0, 3.0
AZIMUTHS = torch.arange(72) * 5 + 1.7
STEP = 0.1
FINE = 16  # samples a pixel along a side, for the truth
METHODS: tuple[Method, ...] = ("opendr", "edges")
VARIANTS = tuple(product(METHODS, (1, 2, 4)))


def chairs(folder: Path | None, count: int) -> Iterator[tuple[str, Mesh]]:
    """Models spread evenly over a folder's, or procedural ones."""
    if folder is None:
        yield from ((f"seed {seed}", chair(seed)) for seed in range(count))
        return
    paths = list(read_models(folder).paths.items())
    for k in np.linspace(0, len(paths) - 1, min(count, len(paths))).round().astype(int):
        name, path = paths[k]
        yield name, load_mesh(path)


def target(mesh: Mesh, number: int) -> Tensor:
    """(1, 1, H, W): the chair as nobody has rendered it, and the same one for the same number."""
    generator = np.random.default_rng(number)
    light = Light(tuple(generator.normal(size=3)), ambient=0.4, diffuse=0.5)
    where = pose(generator.uniform(0, 360), ELEVATION, DISTANCE, 0, 1.3, -0.8)
    clutter = sample_photographs()[number % len(sample_photographs())][None]
    clean = Renderer(mesh, CAMERA, light=light)(where, clutter)
    return (clean + torch.from_numpy(generator.normal(0, 0.02, clean.shape)).float()).clamp(0, 1)


def poses(azimuths: Tensor) -> Tensor:
    return torch.cat([pose(float(azimuth), ELEVATION, DISTANCE) for azimuth in azimuths])


def true_slopes(mesh: Mesh, wanted: Tensor, spec: HOGSpec, fineness: int = 1) -> Tensor:
    """(72,): central differences of the similarity; ``fineness`` is a factor of :data:`FINE`."""
    camera = Camera(CAMERA.focal * fineness, CAMERA.height * fineness, CAMERA.width * fineness)
    renderer = Renderer(mesh, camera, supersampling=FINE)

    def similarity(where: Tensor) -> Tensor:
        return (hog(avg_pool2d(renderer(where), fineness), spec) * wanted).sum()

    before, after = (
        torch.stack([similarity(where) for where in poses(AZIMUTHS + shift).split(1)]) for shift in (-STEP, STEP)
    )
    return (after - before) / (2 * STEP)


def slopes(mesh: Mesh, wanted: Tensor, spec: HOGSpec, method: Method, supersampling: int) -> Tensor:
    """(72,): the derivatives by azimuth that a search would follow."""
    renderer = Renderer(mesh, CAMERA, method=method, supersampling=supersampling)
    where = poses(AZIMUTHS).requires_grad_()
    (result,) = torch.autograd.grad((hog(renderer(where), spec) * wanted).sum(), where)
    return result[:, 0]


def agreement(result: Tensor, true: Tensor) -> tuple[float, float]:
    """Cosine of the two rows of slopes, and the share of equal signs."""
    cosine = torch.nn.functional.cosine_similarity(result.double(), true.double(), dim=0)
    return float(cosine), float((result.sign() == true.sign()).double().mean())


def cell(cosine: float, signs: float) -> str:
    return f"{cosine:.3f} / {100 * signs:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, metavar="DIR", help="CAD models; by default procedural chairs")
    parser.add_argument("--chairs", type=int, default=10, help="how many, spread over the folder (default 10)")
    parser.add_argument("--descriptor", choices=DESCRIPTORS, default="paper")
    parser.add_argument("--check", type=int, default=2, help="chairs whose truth is computed at 32× too (default 2)")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    spec = DESCRIPTORS[options.descriptor]()

    print(f"{options.descriptor}, {SIDE}×{SIDE}; cosine / % of signs\n")
    print("| chair | faces | " + " | ".join(f"{method} {step}×" for method, step in VARIANTS) + " | truth at 32× |")
    print("|---|---:|" + "---:|" * (len(VARIANTS) + 1))
    scores, itself = [], []
    for number, (name, mesh) in enumerate(chairs(options.models, options.chairs)):
        wanted = hog(target(mesh, number), spec)
        true = true_slopes(mesh, wanted, spec)
        scores.append([agreement(slopes(mesh, wanted, spec, *variant), true) for variant in VARIANTS])
        if number < options.check:
            itself.append(agreement(true, true_slopes(mesh, wanted, spec, fineness=2)))
        checked = cell(*itself[number]) if number < options.check else ""
        row = " | ".join(cell(*score) for score in scores[-1])
        print(f"| {name} | {len(mesh.faces)} | {row} | {checked} |", flush=True)
    means = " | ".join(cell(*score) for score in np.mean(scores, axis=0))
    print(f"| **mean** | | {means} | {cell(*np.mean(itself, axis=0)) if itself else ''} |")


if __name__ == "__main__":
    main()
