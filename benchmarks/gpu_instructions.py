"""How many instructions the passes over images take for a pixel, counted without a GPU, and what a device reaches.

    python benchmarks/gpu_instructions.py [--preset uoctti] [--size 4096] [--channels 1] [--dtype float32]

The kernels are compiled as by gpu_compiled.py, and NVIDIA's disassembler says what is in them.  Of the pass to cells,
three nested loops are counted as often as they are run: bands of rows, columns that a lane reads at a time, rows.  The
pass back has no loop.  A device starts at most one instruction of a warp a cycle in each of the four parts of a
multiprocessor.  The least time by instructions stands beside that by bandwidth: the image read once and the cells
written, or the image read and its gradient written.  Waits, caches and normalisers are left out.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import torch
import triton

from gpu_compiled import compiled
from nablahog.hog import presets
from nablahog.hog.triton import launch


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
PARTS = 4  # of a multiprocessor


def listing(kernel: Any) -> list[tuple[int, str]]:
    """Addresses and instructions."""
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(kernel.asm["cubin"])
        file.flush()
        program = Path(triton.__path__[0]) / "backends" / "nvidia" / "bin" / "cuobjdump"
        done = subprocess.run([program, "-sass", file.name], capture_output=True, text=True, check=True)
    return [(int(at, 16), what) for at, what in re.findall(r"/\*([0-9a-f]{4,5})\*/\s+(.*?);", done.stdout)]


def nest(instructions: list[tuple[int, str]]) -> list[int]:
    """How many instructions the loops of the first nest of three have, from the outermost."""
    number = {at: k for k, (at, _) in enumerate(instructions)}
    loops = []
    for k, (at, what) in enumerate(instructions):
        back = re.search(r"BRA.*?(0x[0-9a-f]+)", what)
        if back and int(back[1], 16) < at:
            loops.append((number[int(back[1], 16)], k + 1))
    inner = next(loop for loop in loops if any(a < loop[0] and loop[1] <= b for a, b in loops))
    around = sorted(loop for loop in loops if loop[0] <= inner[0] and inner[1] <= loop[1])
    assert len(around) == 3, around
    return [end - start for start, end in around]


def of_cells(kernel: Any, preset: str, images: torch.Tensor) -> int:
    """Instructions of warps of the pass to cells."""
    spec = presets.BY_NAME[preset]
    known = launch.plan(spec, images.shape, images.dtype, launch.real_dtype(images), images.device)
    rows, cols = known.rows, known.cols
    share = launch.work(len(images), rows.cells, cols.cells, cols.bands.reach)
    bands = share.of_strip + rows.bands.reach - 1
    at_once = launch.columns_at_once(cols.bands.longest, 8 if known.reading.channels == 1 else 4)
    starts = cols.bands.longest // at_once
    instructions = listing(kernel)
    band, start, row = nest(instructions)
    once = len(instructions) - band
    of_band = band - start + starts * (start - row + rows.bands.longest * row)
    return (once + bands * of_band) * len(images) * share.groups * share.chunks


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
    print("| device | preset | pass | instructions of a warp for a pixel | ms by instructions | by bandwidth | share |")
    print("|---|---|---|---:|---:|---:|---:|")
    for capability, devices in DEVICES.items():
        for preset in args.preset:
            kernels = compiled(preset, tuple(images.shape), images.dtype, capability)
            forward = next(kernel for kernel in kernels if kernel.metadata.name == "cells_kernel")
            back = next(kernel for kernel in kernels if kernel.metadata.name == "cells_vjp_kernel")
            tiles = -(-args.size // (launch.VJP_ROWS - 2)) * -(-args.size // (launch.VJP_COLUMNS - 2))
            rows, cols = presets.BY_NAME[preset].cells(args.size, args.size)
            cells = rows * cols * presets.BY_NAME[preset].bins * 4
            for name, count, moved in (
                ("to cells", of_cells(forward, preset, images), images.nbytes + cells),
                ("back", len(listing(back)) * back.metadata.num_warps * tiles, 2 * images.nbytes + cells),
            ):
                for device in devices:
                    by_count = count / (device.multiprocessors * PARTS * device.clock)
                    by_bandwidth = moved / device.bandwidth
                    print(
                        f"| {device.name} | `{preset}` | {name} | {count / pixels:.1f} | {1e3 * by_count:.3f} | "
                        f"{1e3 * by_bandwidth:.3f} | {by_bandwidth / max(by_count, by_bandwidth):.0%} |"
                    )


if __name__ == "__main__":
    main()
