"""How many instructions the passes over images take for a pixel, counted without a GPU, and what a device reaches.

    python benchmarks/gpu_instructions.py [--preset uoctti] [--size 4096] [--channels 1] [--dtype float32]

The kernels are compiled as by gpu_compiled.py, and NVIDIA's disassembler says what is in them.  Of the pass to cells,
three nested loops are counted as often as they are run: bands of rows, columns that a lane reads at a time, rows.  The
pass back has no loop.

A multiprocessor has four schedulers, each of which starts at most one instruction of a warp a cycle, and has units of
its own for arithmetic, comparisons and integers, functions, and memory; these take several cycles for a warp (CUDA
Programming Guide, "Throughput of Native Arithmetic Instructions").  The slowest of them, or the scheduler, is the
limit; the one with most warps is the last to end.  The least time by instructions stands beside that by bandwidth: the
image read once and the cells written, or the image read and its gradient written.  Waits for memory, caches and
normalisers are left out.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import torch
import triton

from gpu_compiled import compiled
from nablahog.hog import presets
from nablahog.hog.triton import launch, parameters

SCHEDULERS = 4  # of a multiprocessor


class Device(NamedTuple):
    """By its data sheet."""

    name: str
    multiprocessors: int
    clock: float  # highest, Hz
    bandwidth: float  # bytes a second


DEVICES = {
    80: [Device("A100, 40 GB", 108, 1.41e9, 1.555e12), Device("A100, 80 GB", 108, 1.41e9, 2.039e12)],
    86: [Device("A10", 72, 1.695e9, 0.6e12)],
    89: [Device("L4", 58, 2.04e9, 0.3e12), Device("RTX 4090", 128, 2.52e9, 1.008e12)],
    90: [Device("H100 SXM", 132, 1.98e9, 3.35e12), Device("H200 SXM", 132, 1.98e9, 4.8e12)],
}
UNITS = {  # names of instructions begin so; all others are comparisons, choices and integers
    "arithmetic": ("FFMA", "FADD", "FMUL", "IMAD", "HFMA2"),
    "functions": ("MUFU", "F2I", "I2F", "FRND", "F2F", "POPC"),
    "memory": ("LD", "ST", "SHFL", "ATOM"),
}
CYCLES = {"integers": 2, "functions": 8, "memory": 4}  # of a unit, for an instruction of a warp


class Count(NamedTuple):
    """Of a program: instructions of warps by unit; how many programs there are."""

    instructions: Counter[str]
    programs: int

    def of_all(self) -> int:
        """Instructions of warps of all programs."""
        return self.programs * self.instructions.total()

    def seconds(self, device: Device, capability: int) -> tuple[float, str]:
        """The least time, and what limits it."""
        cycles = {unit: cost * self.instructions[unit] for unit, cost in CYCLES.items()}
        cycles["arithmetic"] = (2 if capability == 80 else 1) * self.instructions["arithmetic"]
        cycles["instructions"] = self.instructions.total()
        limit = max(cycles, key=lambda what: cycles[what])
        rounds = -(-self.programs // (SCHEDULERS * device.multiprocessors))
        return rounds * cycles[limit] / device.clock, limit


def unit(instruction: str) -> str:
    """That computes it."""
    name = re.sub(r"^@!?U?P\w+ ", "", instruction)
    return next((unit for unit, names in UNITS.items() if name.startswith(names)), "integers")


def listing(kernel: Any) -> list[tuple[int, str]]:
    """Addresses and instructions."""
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(kernel.asm["cubin"])
        file.flush()
        program = Path(triton.__path__[0]) / "backends" / "nvidia" / "bin" / "cuobjdump"
        done = subprocess.run([program, "-sass", file.name], capture_output=True, text=True, check=True)
    return [(int(at, 16), what) for at, what in re.findall(r"/\*([0-9a-f]{4,5})\*/\s+(.*?);", done.stdout)]


def nest(instructions: list[tuple[int, str]]) -> list[tuple[int, int]]:
    """The loops of the first nest of three, from the outermost: the first instruction and the one after the last."""
    number = {at: k for k, (at, _) in enumerate(instructions)}
    loops = []
    for k, (at, what) in enumerate(instructions):
        back = re.search(r"BRA.*?(0x[0-9a-f]+)", what)
        if back and int(back[1], 16) < at:
            loops.append((number[int(back[1], 16)], k + 1))
    inner = next(loop for loop in loops if any(a < loop[0] and loop[1] <= b for a, b in loops))
    around = sorted(loop for loop in loops if loop[0] <= inner[0] and inner[1] <= loop[1])
    assert len(around) == 3, around
    return around


def of_cells(kernel: Any, preset: str, images: torch.Tensor, device: Device) -> Count:
    """The pass to cells."""
    spec = presets.BY_NAME[preset]
    known = parameters.plan(spec, images.shape, images.dtype, launch.real_dtype(images), images.device)
    rows, cols = known.rows, known.cols
    reach = rows.bands.reach, cols.bands.reach
    share = launch.work(len(images), (rows.cells, cols.cells), reach, SCHEDULERS * device.multiprocessors)
    at_once = parameters.columns_at_once(cols.bands, known.reading.channels)
    often = (share.of_strip + rows.bands.reach - 1, cols.bands.longest // at_once, rows.bands.longest)
    instructions = listing(kernel)
    loops = nest(instructions)
    count: Counter[str] = Counter()
    for k, (_, what) in enumerate(instructions):
        times = 1
        for (first, end), of_loop in zip(loops, often, strict=True):
            times *= of_loop if first <= k < end else 1
        count[unit(what)] += times
    return Count(count, len(images) * share.groups * share.chunks)


def of_vjp(kernel: Any, images: torch.Tensor) -> Count:
    """The pass back."""
    tiles = [-(-images.shape[2] // (launch.VJP_ROWS - 2)), -(-images.shape[3] // (launch.VJP_COLUMNS - 2))]
    warps = len(images) * tiles[0] * tiles[1] * kernel.metadata.num_warps
    return Count(Counter(unit(what) for _, what in listing(kernel)), warps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", nargs="+", default=["paper", "uoctti", "skimage"], choices=[*presets.BY_NAME])
    parser.add_argument("--size", type=int, default=4096)
    parser.add_argument("--channels", type=int, default=1)
    parser.add_argument("--dtype", default="float32", choices=["uint8", "float16", "bfloat16", "float32"])
    args = parser.parse_args()
    images = torch.empty((1, args.channels, args.size, args.size), dtype=getattr(torch, args.dtype))
    pixels = args.size * args.size
    print(f"Triton {triton.__version__}, images of {args.size} x {args.size}, {args.channels} channels, {args.dtype}\n")
    print("| device | preset | pass | instructions of a warp for a pixel | ms | limit | by bandwidth, ms | share |")
    print("|---|---|---|---:|---:|---|---:|---:|")
    for capability, devices in DEVICES.items():
        for preset in args.preset:
            kernels = compiled(preset, tuple(images.shape), images.dtype, capability)
            forward = next(kernel for kernel in kernels if kernel.metadata.name == "cells_kernel")
            back = next(kernel for kernel in kernels if kernel.metadata.name == "cells_vjp_kernel")
            rows, cols = presets.BY_NAME[preset].cells(args.size, args.size)
            cells = rows * cols * presets.BY_NAME[preset].bins * 4
            for device in devices:
                for name, count, moved in (
                    ("to cells", of_cells(forward, preset, images, device), images.nbytes + cells),
                    ("back", of_vjp(back, images), 2 * images.nbytes + cells),
                ):
                    seconds, limit = count.seconds(device, capability)
                    by_bandwidth = moved / device.bandwidth
                    share = by_bandwidth / max(seconds, by_bandwidth)
                    print(
                        f"| {device.name} | `{preset}` | {name} | {count.of_all() / pixels:.1f} | {1e3 * seconds:.3f} "
                        f"| {limit} | {1e3 * by_bandwidth:.3f} | {share:.0%} |"
                    )


if __name__ == "__main__":
    main()
