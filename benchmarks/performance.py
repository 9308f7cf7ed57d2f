"""How fast the package is beside its peers, how that grows, and how far it is from what the machine can do.

    python benchmarks/performance.py [--vlfeat LIB] [--dlib LIB] [--images DIR] [--models DIR] [--quick] [--out docs]

prints the page and writes performance.json, performance.md and performance-*.svg.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import torch

import growth
import limits
import searches
from goals import PAPERS
from machine import processor
from memory import printed_by
from parts import of_operator
from performance_page import write_page
from programs import Program, add_libraries, given_libraries, programs

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    Attributes:
        tables: batch and side of the first tables.
        compiled: those at which `torch.compile` takes part.
        sides, batches: of the curves; batches of images of ``batch_side``.
        seconds: to spend on a shape of the tables, of the curves, and on each other measurement.
        memory_side, parts_side, faces_side: pixels of a side.
        memory_of: the programs; None for all that need not be compiled.
        faces, models, scenes, preimages: how many.
        preimage_side: what is left of the photographs; None for all.
        sizes: bytes whose bandwidth is measured.
    """

    tables: tuple[tuple[int, int], ...] = ((1, 128), (1, 512), (1, 2048), (64, 128))
    compiled: tuple[tuple[int, int], ...] = ((1, 512), (64, 128))
    sides: tuple[int, ...] = (64, 128, 256, 512, 1024, 2048, 4096, 8192)
    batches: tuple[int, ...] = (1, 4, 16, 64, 256, 1024)
    batch_side: int = 128
    seconds: tuple[float, float, float] = (15.0, 3.0, 6.0)
    memory_side: int = 2048
    memory_of: tuple[str, ...] | None = None
    parts_side: int = 512
    faces_side: int = 128
    threads: tuple[tuple[int, int], ...] = ((1, 512), (64, 128))
    faces: tuple[int, ...] = (500, 5000, 50_000, 500_000)
    models: int = 16
    scenes: int = 12
    preimages: int = 4
    preimage_side: int | None = None
    sizes: tuple[int, ...] = limits.SIZES


QUICK = Extent(
    tables=((1, 64), (4, 32)),
    compiled=(),
    sides=(64, 96),
    batches=(1, 4),
    batch_side=32,
    seconds=(0.3, 0.1, 0.2),
    memory_side=256,
    memory_of=(PAPERS,),
    parts_side=64,
    faces_side=32,
    threads=((1, 64),),
    faces=(500, 1000),
    models=2,
    scenes=1,
    preimages=1,
    preimage_side=32,
    sizes=limits.QUICK_SIZES,
)


def shapes(extent: Extent) -> list[growth.Shape]:
    """All shapes of the tables and the curves, growing."""
    every = {(1, side) for side in extent.sides} | {(batch, extent.batch_side) for batch in extent.batches}
    ordered = sorted(every | set(extent.tables), key=lambda shape: (shape[0] * shape[1] ** 2, shape))
    return [
        growth.Shape(*s, s in extent.tables, s in extent.compiled, extent.seconds[0 if s in extent.tables else 1])
        for s in ordered
    ]


def memory(every: list[Program], extent: Extent, libraries: dict[str, Path]) -> dict[str, Any]:
    """MiB of one call of each program in a fresh process."""
    options = [part for name, path in libraries.items() for part in (f"--{name}", str(path))]
    program, side = str(Path(__file__).with_name("programs.py")), extent.memory_side
    names = extent.memory_of or [p.name for p in every if p.where != "compiled"]
    result = {name: printed_by(program, [name, "1", str(side), *options]) for name in names}
    return {"side": side, "image_mib": side**2 * limits.IMAGE / 2**20, "programs": result}


def machine() -> dict[str, Any]:
    libraries = {name: version(name) for name in ("torch", "numpy", "scikit-image")}
    others = {"OpenCV": cv2.getVersionString(), "Python": platform.python_version()}
    return libraries | others | {platform.system(): f"{platform.machine()}, {os.cpu_count()} CPUs ({processor()})"}


def operator_parts(every: list[Program], side: int, seconds: float, rates: limits.Rates) -> dict[str, Any]:
    """Of each dialect."""
    specs = {p.name: p.spec for p in every if p.spec is not None and not p.backward and p.where == "all"}
    return {"side": side, "programs": {name: of_operator(spec, side, seconds, rates) for name, spec in specs.items()}}


def measured(extent: Extent, libraries: dict[str, Path], images: Path | None, models: Path | None) -> dict[str, Any]:
    """Everything, by name."""
    every = programs(libraries)
    rates = limits.measured(extent.sizes)
    record: dict[str, Any] = {"limits": dataclasses.asdict(rates)}

    def step(name: str, measure: Callable[[], Any]) -> None:
        start = time.perf_counter()
        record[name] = measure()
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)

    step("memory", lambda: memory(every, extent, libraries))
    taken = {name: mib for name, mib in record["memory"]["programs"].items() if mib is not None}
    a_pixel = {name: mib * 2**20 / extent.memory_side**2 for name, mib in taken.items()}
    step("operator", lambda: growth.operator(every, shapes(extent), a_pixel))
    seconds = extent.seconds[2]
    step("parts", lambda: operator_parts(every, extent.parts_side, seconds / 2, rates))
    step("threads", lambda: growth.threads(every, extent.threads, seconds / 2))
    step("faces", lambda: growth.faces(extent.faces, extent.faces_side, seconds / 2))
    step("models", lambda: growth.models(models, extent.models, min(3, extent.scenes)))
    step("preimages", lambda: searches.preimages(images, extent.preimages, extent.preimage_side, rates))
    step("poses", lambda: searches.poses(models, extent.scenes, rates))
    return record


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    add_libraries(parser)
    parser.add_argument(
        "--images", type=Path, metavar="DIR", help="photographs of one size; by default those of scikit-image"
    )
    parser.add_argument("--models", type=Path, metavar="DIR", help="CAD models; by default procedural chairs")
    parser.add_argument("--quick", action="store_true", help="tiny images and few repeats: does it run at all?")
    parser.add_argument("--out", type=Path, help="folder to write to (default docs; with --quick out/performance)")
    options = parser.parse_args()
    out = options.out or ROOT / ("out/performance" if options.quick else "docs")
    if options.quick and out.resolve() == (ROOT / "docs").resolve():
        parser.error("a smoke run is no measurement, and not for docs: give another folder by --out")
    torch.set_num_threads(1)
    libraries = given_libraries(options)
    start = time.perf_counter()
    result = measured(QUICK if options.quick else Extent(), libraries, options.images, options.models)
    record = {
        "quick": options.quick,
        "machine": machine(),
        "given": [*libraries, *(name for name in ("images", "models") if getattr(options, name) is not None)],
        "seconds": time.perf_counter() - start,
        **result,
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "performance.json").write_text(json.dumps(record, indent=1) + "\n")
    print(write_page(out))


if __name__ == "__main__":
    main()
