"""How fast is the renderer, how does that grow, and is its derivative the one to follow?

    python benchmarks/rendering.py speed [--seconds 3] [--quick]
    python benchmarks/rendering.py derivative [--models DIR] [--chairs 10] [--descriptor paper]

Speed: a chair, the finer the more faces it has, is seen from eight sides in one batch.  Times are CPU milliseconds a
rendering.  With derivative means the image, its motion, and one product of a gradient with it; the last column is how
many times as fast as the paper's renderer that is.  Preparing, once a mesh, finds its edges and shades it.

Derivative: the similarity of a picture to a target is the dot product of their descriptors.  The target is the chair at
some azimuth, before clutter, under another light, with noise.  At 72 azimuths the derivative of the similarity is
compared with a central difference over ±0.1° of the similarity of a rendering with 16×16 samples a pixel: cosine of the
two rows of slopes, and the share of equal signs in %.  1 / 100 is the best possible, a random direction has 0 / 50.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
import trimesh
from torch import Tensor

from nablahog.hog import HOGSpec, hog
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.paper.scenes import CHAIRS
from nablahog.render import Camera, Light, Mesh, Renderer, pose, pose_vjp
from nablahog.render.models import Model, read_models
from nablahog.render.renderer import EdgeMethod
from preimages import SIDE, photographs
from timing import Call, Times, cell, digits, in_turns, processor, ratio, summary, table, times_as_fast

BATCH = 8
METHODS: tuple[EdgeMethod, ...] = ("edges", "opendr")
STEPS = (1, 2, 4)
ALL = os.cpu_count() or 1


class Case(NamedTuple):
    """A chair of 4**finer times the faces on a picture of ``side`` pixels."""

    finer: int
    side: int
    samples: int
    threads: int


CASES = [
    *(Case(finer, 128, step, 1) for finer in range(5) for step in STEPS),
    *(Case(1, side, step, 1) for side in (64, 256, 512) for step in STEPS),
    *(Case(1, 128, step, ALL) for step in STEPS if ALL > 1),
]


def divided_chair(finer: int) -> Mesh:
    """A chair each of whose faces is divided into four so often."""
    mesh = Model("chair-03", CHAIRS).mesh()
    vertices, faces = mesh.vertices.numpy(), mesh.faces.numpy()
    for _ in range(finer):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    brightness = torch.full((len(vertices),), 0.8, dtype=torch.float64)
    return Mesh(torch.from_numpy(vertices), torch.from_numpy(faces), brightness)


def prepared(mesh: Mesh, case: Case, method: EdgeMethod = "edges") -> Renderer:
    """The renderer with everything made that it makes once."""
    camera = Camera(2.6 * case.side, case.side, case.side)
    renderer = Renderer(mesh, camera, supersampling=case.samples, method=method)
    renderer.render(pose(0), torch.ones(1, case.side, case.side), derivative=False)
    return renderer


def calls(renderer: Renderer) -> dict[str, Call]:
    """One batch each, ready to be timed."""
    camera = renderer.camera
    poses = torch.cat([pose(45 * k + 10, 20) for k in range(BATCH)])
    background = torch.ones(1, camera.height, camera.width)
    grad_image = torch.rand(BATCH, camera.height, camera.width, generator=torch.Generator().manual_seed(0))

    def with_derivative() -> object:
        rendering = renderer.render(poses, background, derivative=True)
        return pose_vjp(grad_image, rendering.screen_gradient, poses, camera)

    return {"forward": lambda: renderer.render(poses, background, derivative=False), "with derivative": with_derivative}


def of_one(batch: Times) -> list[float]:
    """CPU milliseconds of one rendering."""
    return [ms / BATCH for ms in batch.cpu]


def speed(options: argparse.Namespace) -> None:
    rows = []
    for case in CASES[:1] if options.quick else CASES:
        torch.set_num_threads(case.threads)
        mesh = divided_chair(case.finer)
        began = time.process_time()
        made = {method: calls(prepared(mesh, case, method)) for method in METHODS}
        preparing = 1e3 * (time.process_time() - began) / len(METHODS)
        every = {f"{method} {what}": call for method, of in made.items() for what, call in of.items()}
        times = {name: of_one(batch) for name, batch in in_turns(every, options.seconds).items()}
        figures = [cell(summary(times[f"edges {what}"])) for what in ("forward", "with derivative")]
        faster = ratio(times["opendr with derivative"], times["edges with derivative"])
        shape = [str(len(mesh.faces)), f"{case.side}²", f"{case.samples}×{case.samples}", str(case.threads)]
        rows.append([*shape, digits(preparing), *figures, times_as_fast(faster)])
    head = ["faces", "pixels", "samples", "threads", "preparing", "forward", "with derivative", "as fast as opendr"]
    print(f"{processor()}; batches of {BATCH}\n\n{table(head, rows)}")


CAMERA = Camera(330, SIDE, SIDE)  # the chair, at three of its diagonals, is some 100 pixels high
ELEVATION, DISTANCE = 20.0, 3.0
AZIMUTHS = torch.arange(72) * 5 + 1.7
DIFFERENCE = 0.1  # degrees
FINE = 16  # samples a pixel along a side, for the truth
VARIANTS = tuple(product(METHODS, STEPS))


def chairs(folder: Path | None, count: int) -> Iterator[tuple[str, Mesh]]:
    """Models spread evenly over a folder's, or those that ship."""
    if folder is None:
        yield from ((f"chair {seed}", Model(f"chair-{seed:02d}", CHAIRS).mesh()) for seed in range(count))
        return
    models, _ = read_models(folder)
    for k in np.linspace(0, len(models) - 1, min(count, len(models))).round().astype(int):
        yield models[k].name, models[k].mesh()


def target(mesh: Mesh, number: int) -> Tensor:
    """(1, 1, H, W): the chair in a scene of its own."""
    generator = np.random.default_rng(number)
    light = Light(tuple(generator.normal(size=3)), ambient=0.4, diffuse=0.5)
    where = pose(generator.uniform(0, 360), ELEVATION, DISTANCE, 0, 1.3, -0.8)
    clutter = photographs(None)[number % 8][None]
    clean = Renderer(mesh, CAMERA, light=light)(where, clutter)
    return (clean + torch.from_numpy(generator.normal(0, 0.02, clean.shape)).float()).clamp(0, 1)


def poses(azimuths: Tensor) -> Tensor:
    return torch.cat([pose(float(azimuth), ELEVATION, DISTANCE) for azimuth in azimuths])


def true_slopes(mesh: Mesh, wanted: Tensor, spec: HOGSpec) -> Tensor:
    """(72,): central differences of the similarity."""
    renderer = Renderer(mesh, CAMERA, supersampling=FINE)

    def similarity(azimuths: Tensor) -> Tensor:
        return torch.stack([(hog(renderer(where), spec) * wanted).sum() for where in poses(azimuths).split(1)])

    return (similarity(AZIMUTHS + DIFFERENCE) - similarity(AZIMUTHS - DIFFERENCE)) / (2 * DIFFERENCE)


def slopes(mesh: Mesh, wanted: Tensor, spec: HOGSpec, method: EdgeMethod, samples: int) -> Tensor:
    """(72,): the derivatives by azimuth that a search would follow."""
    renderer = Renderer(mesh, CAMERA, method=method, supersampling=samples)
    where = poses(AZIMUTHS).requires_grad_()
    (result,) = torch.autograd.grad((hog(renderer(where), spec) * wanted).sum(), where)
    return result[:, 0]


def agreement(result: Tensor, true: Tensor) -> tuple[float, float]:
    """Cosine of the two rows of slopes, and the share of equal signs."""
    cosine = torch.nn.functional.cosine_similarity(result.double(), true.double(), dim=0)
    return float(cosine), float((result.sign() == true.sign()).double().mean())


def derivative(options: argparse.Namespace) -> None:
    torch.set_num_threads(1)
    spec = DEFAULT_SPECS[options.descriptor]
    scores, rows = [], []
    for number, (name, mesh) in enumerate(chairs(options.models, options.chairs)):
        wanted = hog(target(mesh, number), spec)
        true = true_slopes(mesh, wanted, spec)
        scores.append([agreement(slopes(mesh, wanted, spec, *variant), true) for variant in VARIANTS])
        rows.append([name, *(f"{cosine:.3f} / {100 * signs:.0f}" for cosine, signs in scores[-1])])
    rows.append(["**mean**", *(f"{cosine:.3f} / {100 * signs:.0f}" for cosine, signs in np.mean(scores, axis=0))])
    print(table(["chair", *(f"{method} {samples}×" for method, samples in VARIANTS)], rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    of_speed = commands.add_parser("speed")
    of_speed.add_argument("--seconds", type=float, default=3.0, help="for each row")
    of_speed.add_argument("--quick", action="store_true", help="one small case: does it run at all?")
    of_speed.set_defaults(run=speed)
    of_derivative = commands.add_parser("derivative")
    of_derivative.add_argument("--models", type=Path, metavar="DIR", help="CAD models; by default chairs that ship")
    of_derivative.add_argument("--chairs", type=int, default=10, help="how many, spread over the folder")
    of_derivative.add_argument("--descriptor", choices=[*DEFAULT_SPECS], default="paper")
    of_derivative.set_defaults(run=derivative)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
