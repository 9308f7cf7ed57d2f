"""Time and memory of the HOG operator beside other programs, each on its own descriptor, as a Markdown table.

All programs of an image size run in turns within the same repeats, so that they share whatever else the machine does.
Memory is by how much one call raises the peak of the resident set of a fresh process (Linux only: VmHWM).
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import skimage
import skimage.data
import skimage.transform
import torch
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets
from peers import NaiveHOG, dlib, opencv, scikit_image, vlfeat

SHAPES = {"1×128²": (1, 128), "1×512²": (1, 512), "1×2048²": (1, 2048), "64×128²": (64, 128)}
QUICK_SHAPES = {"1×128²": (1, 128), "4×128²": (4, 128)}


@dataclass(frozen=True)
class Program:
    """One line of the table.

    Attributes:
        name: unique.
        make: from gray images, uint8 (B, H, W), to a call that describes them.
        beside: the program whose time is divided by this one's, if another.
    """

    name: str
    make: Callable[[Any], Callable[[], Any]]
    beside: str | None = None


def floats(images: Any) -> Tensor:
    """(B, 1, H, W) in 0…1."""
    return torch.from_numpy(images).unsqueeze(1).float() / 255


def forward(describe: Callable[[Tensor], Tensor], images: Any) -> Callable[[], Any]:
    x = floats(images)
    return lambda: describe(x)


def with_backward(describe: Callable[[Tensor], Tensor], images: Any) -> Callable[[], Any]:
    x = floats(images).requires_grad_()
    with torch.no_grad():
        given = torch.ones_like(describe(x))

    def call() -> Any:
        return torch.autograd.grad(describe(x), x, given)

    return call


def ours(spec: HOGSpec, **options: Any) -> Callable[[Tensor], Tensor]:
    return functools.partial(hog, spec=spec, **options)


def programs(libraries: dict[str, Path]) -> list[Program]:
    """All that can run here, of C libraries those that are given."""
    skimage_s, paper, uoctti = presets.skimage(), presets.paper(), presets.uoctti(colour="gray")
    naive = NaiveHOG()
    found = [
        Program("scikit-image", scikit_image),
        Program("ours, scikit-image's", functools.partial(forward, ours(skimage_s)), "scikit-image"),
        Program("OpenCV", opencv),
        Program("ours, OpenCV's", functools.partial(forward, ours(presets.opencv(gamma=False))), "OpenCV"),
    ]
    bilinear = "VLFeat" if "vlfeat" in libraries else None
    if "vlfeat" in libraries:
        found.append(Program("VLFeat", vlfeat(libraries["vlfeat"])))
    found += [
        Program("ours, VLFeat's", functools.partial(forward, ours(uoctti)), bilinear),
        Program("ours, VLFeat's, with backward", functools.partial(with_backward, ours(uoctti)), bilinear),
    ]
    hard = "dlib" if "dlib" in libraries else None
    if "dlib" in libraries:
        found.append(Program("dlib", dlib(libraries["dlib"])))
    return [
        *found,
        Program("ours, dlib's", functools.partial(forward, ours(presets.dlib())), hard),
        Program("naive torch", functools.partial(forward, naive)),
        Program(
            "ours, the paper's, plain steps", functools.partial(forward, ours(paper, backend="torch")), "naive torch"
        ),
        Program("ours, the paper's", functools.partial(forward, ours(paper)), "naive torch"),
        Program("naive torch, with backward", functools.partial(with_backward, naive)),
        Program(
            "ours, the paper's, with backward",
            functools.partial(with_backward, ours(paper)),
            "naive torch, with backward",
        ),
    ]


def photographs(batch: int, side: int) -> Any:
    """uint8 (B, side, side): scikit-image's photograph of a cameraman, as often as asked for."""
    image = skimage.transform.resize(skimage.data.camera(), (side, side), anti_aliasing=True, preserve_range=True)
    return np.repeat(image.round().astype(np.uint8)[None], batch, axis=0)


def timed(of: list[Program], images: Any, seconds: float, least: int) -> dict[str, dict[str, list[float]]]:
    """Wall and CPU milliseconds a call of each program, in turns, for about ``seconds`` and ``least`` turns or more."""
    calls = {program.name: program.make(images) for program in of}
    for call in calls.values():
        call()  # not counted: allocates, and compiles or loads what is needed for the first time
    times: dict[str, dict[str, list[float]]] = {name: {"wall_ms": [], "cpu_ms": []} for name in calls}
    end = time.perf_counter() + seconds
    turns = 0
    while turns < least or time.perf_counter() < end:
        for name, call in calls.items():
            wall, cpu = time.perf_counter(), time.process_time()
            call()
            times[name]["wall_ms"].append(1e3 * (time.perf_counter() - wall))
            times[name]["cpu_ms"].append(1e3 * (time.process_time() - cpu))
        turns += 1
    return times


def peak_kib() -> int:
    """Highest resident set of this process, in KiB, since the last reset."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def memory_case(program: Program, batch: int, side: int) -> None:
    """Print the memory of one call in MiB; run in a process of its own."""
    program.make(photographs(1, 32))()  # loads what is loaded on first use
    call = program.make(photographs(batch, side))
    # imports peak higher than they end, and a new process even inherits the peak of its parent in ru_maxrss
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_kib()
    call()
    print((peak_kib() - before) / 1024)


def memory_mib(name: str, shape: tuple[int, int], options: list[str]) -> float | None:
    """Memory of one call in a fresh process; None where the system does not tell."""
    command = [sys.executable, __file__, *options, "--memory-case", name, *map(str, shape)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return float(done.stdout) if done.returncode == 0 else None


def summary(values: list[float]) -> dict[str, float]:
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def cell(stats: dict[str, float]) -> str:
    return f"{stats['median']:.3g} ({stats['min']:.3g}…{stats['max']:.3g})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="small images and few repeats: does it run at all?")
    parser.add_argument("--threads", type=int, default=1, help="threads of PyTorch (default 1; the others have one)")
    parser.add_argument("--seconds", type=float, default=15, help="time to spend on each image size (default 15)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers there as well")
    for library in ("vlfeat", "dlib"):
        parser.add_argument(f"--{library}", type=Path, metavar="FILE", help="a shared library, see README.md")
    parser.add_argument("--memory-case", nargs=3, metavar=("PROGRAM", "BATCH", "SIDE"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    libraries = {n: getattr(arguments, n) for n in ("vlfeat", "dlib") if getattr(arguments, n)}
    every = programs(libraries)
    if arguments.memory_case:
        name, batch, side = arguments.memory_case
        memory_case(next(program for program in every if program.name == name), int(batch), int(side))
        return
    options = ["--threads", str(arguments.threads)]
    for name, path in libraries.items():
        options += [f"--{name}", str(path)]
    machine = {
        "torch": torch.__version__,
        "numpy": np.__version__,
        "scikit-image": skimage.__version__,
        "OpenCV": cv2.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "threads": arguments.threads,
    }
    print(", ".join(f"{key} {value}" for key, value in machine.items()) + "; gray photograph, cells of 8\n")
    print("| images | program | wall ms: median (min…max) | CPU ms: median (min…max) | times as fast | MiB |")
    print("|---|---|---:|---:|---|---:|")
    rows: list[dict[str, Any]] = []
    for label, shape in (QUICK_SHAPES if arguments.quick else SHAPES).items():
        times = timed(every, photographs(*shape), seconds=0.5 if arguments.quick else arguments.seconds, least=3)
        medians = {name: statistics.median(clocks["cpu_ms"]) for name, clocks in times.items()}
        for program in every:
            stats = {clock: summary(values) for clock, values in times[program.name].items()}
            memory = memory_mib(program.name, shape, options)
            ratio = medians[program.beside] / medians[program.name] if program.beside else None
            rows.append(
                {
                    "images": label,
                    "program": program.name,
                    **stats,
                    "repeats": len(times[program.name]["wall_ms"]),
                    "beside": program.beside,
                    "ratio": ratio,
                    "memory_mib": memory,
                }
            )
            faster = "" if ratio is None else f"{ratio:.2f} × {program.beside}"
            shown = "–" if memory is None else f"{memory:.1f}"
            clocks = f"{cell(stats['wall_ms'])} | {cell(stats['cpu_ms'])}"
            print(f"| {label} | {program.name} | {clocks} | {faster} | {shown} |", flush=True)
    print("\nTimes as fast: by CPU medians; above 1, this program is the faster one.")
    if arguments.json:
        arguments.json.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
