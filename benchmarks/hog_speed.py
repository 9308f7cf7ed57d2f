"""Time and memory of the HOG operator beside scikit-image's ``hog``, as a Markdown table.

All programs of an image size run in turns within the same repeats, so that they share whatever else the machine does.
Memory is by how much one call raises the peak of the resident set of a fresh process (Linux only: VmHWM).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import skimage
import skimage.feature
import torch

from nablahog.hog import hog, presets

SHAPES = {"1×128²": (1, 128), "1×512²": (1, 512), "1×2048²": (1, 2048), "64×128²": (64, 128)}
QUICK_SHAPES = {"1×128²": (1, 128), "4×128²": (4, 128)}
SPECS = {"paper": presets.paper(), "uoctti": presets.uoctti()}
SKIMAGE = "scikit-image"
PROGRAMS = (SKIMAGE, *(f"{spec}, {mode}" for spec in SPECS for mode in ("forward", "forward + backward")))


def program(name: str, batch: int, side: int) -> Callable[[], object]:
    """One call of a program on a batch of float32 gray images, ready to be timed."""
    images = torch.rand(batch, 1, side, side, generator=torch.Generator().manual_seed(0))
    if name == SKIMAGE:
        arrays = list(images[:, 0].numpy())
        return lambda: [skimage.feature.hog(array) for array in arrays]
    preset, mode = name.split(", ")
    spec = SPECS[preset]
    if mode == "forward":
        return lambda: hog(images, spec)
    images.requires_grad_()

    def forward_and_backward() -> object:
        images.grad = None
        return hog(images, spec).sum().backward()  # type: ignore[no-untyped-call]

    return forward_and_backward


def timed(shape: tuple[int, int], seconds: float, least: int) -> dict[str, dict[str, list[float]]]:
    """Wall and CPU milliseconds a call of each program, in turns, for about ``seconds`` and ``least`` turns or more."""
    calls = {name: program(name, *shape) for name in PROGRAMS}
    for call in calls.values():
        call()  # not counted: allocates, and loads what is loaded on first use
    times: dict[str, dict[str, list[float]]] = {name: {"wall_ms": [], "cpu_ms": []} for name in PROGRAMS}
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


def memory_case(name: str, batch: int, side: int) -> None:
    """Print the memory of one call in MiB; run in a process of its own."""
    program(name, 1, 32)()  # loads what is loaded on first use
    call = program(name, batch, side)
    # imports peak higher than they end, and a new process even inherits the peak of its parent in ru_maxrss
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_kib()
    call()
    print((peak_kib() - before) / 1024)


def memory_mib(name: str, shape: tuple[int, int], threads: int) -> float | None:
    """Memory of one call in a fresh process; None where the system does not tell."""
    command = [sys.executable, __file__, "--threads", str(threads), "--memory-case", name, *map(str, shape)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return float(done.stdout) if done.returncode == 0 else None


def summary(values: list[float]) -> dict[str, float]:
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def cell(stats: dict[str, float]) -> str:
    return f"{stats['median']:.3g} ({stats['min']:.3g}…{stats['max']:.3g})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="small images and few repeats: does it run at all?")
    parser.add_argument("--threads", type=int, default=1, help="threads of PyTorch (default 1; scikit-image has one)")
    parser.add_argument("--seconds", type=float, default=15, help="time to spend on each image size (default 15)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers there as well")
    parser.add_argument("--memory-case", nargs=3, metavar=("PROGRAM", "BATCH", "SIDE"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    if arguments.memory_case:
        name, batch, side = arguments.memory_case
        memory_case(name, int(batch), int(side))
        return

    machine = {
        "torch": torch.__version__,
        "numpy": np.__version__,
        "scikit-image": skimage.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "threads": arguments.threads,
    }
    print(", ".join(f"{key} {value}" for key, value in machine.items()) + "; gray float32, cells of 8\n")
    print("| images | program | wall ms: median (min…max) | CPU ms: median (min…max) | scikit-image / this | MiB |")
    print("|---|---|---:|---:|---:|---:|")
    rows: list[dict[str, Any]] = []
    for label, shape in (QUICK_SHAPES if arguments.quick else SHAPES).items():
        times = timed(shape, seconds=0.5 if arguments.quick else arguments.seconds, least=3)
        base = statistics.median(times[SKIMAGE]["cpu_ms"])
        for name in PROGRAMS:
            stats = {clock: summary(values) for clock, values in times[name].items()}
            memory = memory_mib(name, shape, arguments.threads)
            ratio = base / stats["cpu_ms"]["median"]
            rows.append(
                {
                    "images": label,
                    "program": name,
                    **stats,
                    "repeats": len(times[name]["wall_ms"]),
                    "ratio": ratio,
                    "memory_mib": memory,
                }
            )
            shown = "–" if memory is None else f"{memory:.1f}"
            print(
                f"| {label} | {name} | {cell(stats['wall_ms'])} | {cell(stats['cpu_ms'])} | {ratio:.2f} | {shown} |",
                flush=True,
            )
    print("\nThe ratio is of CPU medians: above 1, this program is faster than scikit-image.")
    if arguments.json:
        arguments.json.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
