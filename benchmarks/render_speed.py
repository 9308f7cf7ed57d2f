"""Time and memory of renderings, forward and with their derivative by the pose, as Markdown tables.

    python benchmarks/render_speed.py [--seconds 3] [--quick] [--json FILE]

A turned chair, the finer the more faces it has, is seen from eight sides in one batch.  Times are those of the batch
over eight.  With derivative means the image, its motion, and what a gradient of the image is by the six parameters of
the pose.  Preparing a mesh, once for all renderings, finds its edges and shades it.  Memory is by how much preparing
and one batch raise the peak of the resident set of a fresh process that holds the mesh (Linux only: VmHWM).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from memory import printed_by, raised_mib
from nablahog.paper.solids import joined, lathe, tube
from nablahog.render import Camera, Mesh, Renderer, pose, pose_vjp
from nablahog.render.renderer import Method
from timing import Call, Times, cell, in_turns

BATCH = 8
ALL = os.cpu_count() or 1


class Case(NamedTuple):
    faces: int
    side: int
    samples: int
    threads: int


STEPS = (1, 2, 4)
TABLES = {
    "Faces": [Case(faces, 128, step, 1) for faces in (500, 5000, 50_000, 500_000) for step in STEPS],
    "Pixels": [Case(5000, side, step, 1) for side in (64, 128, 256, 512) for step in STEPS],
    "Threads": [Case(5000, 128, step, threads) for threads in sorted({1, ALL}) for step in STEPS],
}
QUICK = {"Quick": [Case(500, 64, 1, 1), Case(500, 64, 2, ALL)]}


def turned_chair(faces: int) -> Mesh:
    """Eleven parts from a lathe: four legs, a seat, and a rail on five spindles; about so many faces."""
    sides = 2 * max(2, round(math.sqrt(faces / 33) / 2))
    share = np.linspace(0, 1, round(faces / 22 / sides))
    baluster = 3 + np.cos(6 * np.pi * share) + np.sin(np.pi * share)

    def part(start: tuple[float, ...], end: tuple[float, ...], diameters: Any) -> Any:
        return lathe(start, end, list(zip(share, diameters, strict=True)), sides=sides)

    parts = [part((1.2 * x, 1.2 * y, 0), (x, y, 42), baluster) for x in (-15, 15) for y in (-15, 15)]
    parts.append(part((0, 0, 41), (0, 0, 47), 46 * (1 - 0.2 * np.abs(2 * share - 1) ** 4)))
    parts += [part((x, 18, 45), (1.2 * x, 24, 88), baluster / 2) for x in (-14, -7, 0, 7, 14)]
    rail = np.stack([np.linspace(-20, 20, len(share)), 25 - 2 * (2 * share - 1) ** 2, 0 * share + 89], axis=1)
    parts.append(tube(rail, [(3, 7)], sides=sides))
    whole = joined(parts)
    brightness = torch.full((len(whole.vertices),), 0.8, dtype=torch.float64)
    return Mesh(torch.from_numpy(whole.vertices), torch.from_numpy(whole.faces), brightness).normalized()


def prepared(mesh: Mesh, case: Case, method: Method = "edges") -> Renderer:
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


def timed(case: Case, seconds: float) -> dict[str, Any]:
    """Milliseconds a rendering, by wall clock and of the processors, in turns for about ``seconds``."""
    torch.set_num_threads(case.threads)
    mesh = turned_chair(case.faces)
    start = time.perf_counter()
    renderer = prepared(mesh, case)
    preparing = 1e3 * (time.perf_counter() - start)
    times = in_turns(calls(renderer), seconds)
    return {
        **case._asdict(),
        "faces": len(renderer.mesh.faces),
        "preparing_ms": preparing,
        **{name: each(clocks).summaries() for name, clocks in times.items()},
    }


def each(batch: Times) -> Times:
    """Times of one rendering, from those of a batch."""
    return Times([ms / BATCH for ms in batch.wall], [ms / BATCH for ms in batch.cpu])


def memory_case(case: Case) -> None:
    """Print by how many MiB preparing and one batch raise the peak; run in a process of its own."""
    torch.set_num_threads(case.threads)
    tiny = Case(500, 16, case.samples, 1)
    calls(prepared(turned_chair(tiny.faces), tiny))["with derivative"]()  # loads what is loaded on first use
    mesh = turned_chair(case.faces)
    print(raised_mib(lambda: calls(prepared(mesh, case))["with derivative"]()))


def memory_mib(case: Case) -> float | None:
    """Memory of one batch in a fresh process; None where the system does not tell."""
    return printed_by(__file__, ["--memory-case", *map(str, case)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two small cases: does it run at all?")
    parser.add_argument("--seconds", type=float, default=3, help="time to spend on each case (default 3)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers there as well")
    parser.add_argument("--memory-case", nargs=4, type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory_case:
        memory_case(Case(*options.memory_case))
        return
    machine = f"torch {torch.__version__}, python {platform.python_version()}, {platform.machine()}, {ALL} CPUs"
    print(f"{machine}; batches of {BATCH}, milliseconds a rendering: median (quartiles)")
    rows = []
    for title, cases in (QUICK if options.quick else TABLES).items():
        print(f"\n{title}\n")
        print(
            "| faces | pixels | samples | threads | preparing | forward | with derivative | its CPU | a second | MiB |"
        )
        print("|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
        for case in cases:
            row = timed(case, 0.5 if options.quick else options.seconds) | {"memory_mib": memory_mib(case)}
            rows.append(row)
            both = row["with derivative"]
            memory = "–" if row["memory_mib"] is None else f"{row['memory_mib']:.0f}"
            a_second = 1e3 / both["wall_ms"]["median"]
            print(
                f"| {row['faces']} | {case.side}² | {case.samples}×{case.samples} | {case.threads} "
                f"| {row['preparing_ms']:.0f} | {cell(row['forward']['wall_ms'])} "
                f"| {cell(both['wall_ms'])} | {cell(both['cpu_ms'])} | {a_second:.0f} | {memory} |",
                flush=True,
            )
    if options.json:
        options.json.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
