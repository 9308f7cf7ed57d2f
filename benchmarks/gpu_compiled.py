"""The kernels of a GPU compiled ahead of time, without a GPU: registers, spills and shared memory, occupancy on paper.

    python benchmarks/gpu_compiled.py [--preset uoctti] [--size 4096] [--channels 1] [--dtype float32] [--sm 80 90]

Each kernel that cells and their vjp need is compiled as it would be for images of this size, and given to
NVIDIA's assembler, ``ptxas``, of Triton's wheel.  Occupancy is how many of an SM's warps its registers, its shared
memory and its blocks leave room for; nothing is run.
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
from triton.backends.compiler import GPUTarget
from triton.backends.nvidia.compiler import get_ptxas
from triton.runtime.jit import JITFunction

from nablahog.hog import presets
from nablahog.hog.triton import steps


class Multiprocessor(NamedTuple):
    """What its warps share: CUDA C++ Programming Guide, "Compute Capabilities"."""

    registers: int = 65536
    warps: int = 64
    blocks: int = 32
    shared: int = 0  # bytes
    reserved: int = 1024  # bytes of shared memory a block, for the system


SMS = {80: Multiprocessor(shared=164 * 1024), 90: Multiprocessor(shared=228 * 1024)}


class Compiled(NamedTuple):
    name: str
    warps: int
    registers: int
    spills: int  # bytes stored and loaded
    shared: int

    def occupancy(self, sm: Multiprocessor) -> tuple[float, str]:
        """Share of the warps, and what limits it."""
        of_a_warp = -(-self.registers * 32 // 256) * 256
        blocks = {
            "registers": sm.registers // of_a_warp // self.warps,
            "shared memory": sm.shared // (self.shared + sm.reserved),
            "blocks": sm.blocks,
            "warps": sm.warps // self.warps,
        }
        limit = min(blocks, key=lambda what: blocks[what])
        return blocks[limit] * self.warps / sm.warps, limit


class NoDevice:
    """In the place of Triton's driver: says what to compile for."""

    def __init__(self, capability: int) -> None:
        self.target = GPUTarget("cuda", capability, 32)

    def get_current_target(self) -> GPUTarget:
        return self.target

    def get_current_device(self) -> int:
        return int(self.target.arch)  # caches of compiled kernels are by device

    def get_current_stream(self, device: int) -> int:
        return 0


def used(kernel: Any, capability: int) -> Compiled:
    """What the assembler says of a compiled kernel."""
    code = kernel.asm["ptx"]
    target = re.search(r"\.target (\w+)", code)
    assert target is not None
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "kernel.ptx"
        source.write_text(code)
        command = [
            get_ptxas(capability).path,
            "-v",
            f"--gpu-name={target[1]}",
            source,
            "-o",
            Path(folder) / "kernel.cubin",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = done.stderr + done.stdout
    if done.returncode:
        raise RuntimeError(said)

    def number(pattern: str) -> int:
        return sum(int(n) for n in re.findall(pattern, said))

    spills = number(r"(\d+) bytes spill stores") + number(r"(\d+) bytes spill loads")
    return Compiled(
        kernel.metadata.name, kernel.metadata.num_warps, number(r"Used (\d+) registers"), spills, kernel.metadata.shared
    )


def compiled(preset: str, shape: tuple[int, ...], dtype: torch.dtype, capability: int) -> list[Any]:
    """Both kernels, of cells and their vjp, as Triton compiles them."""
    kernels: list[Any] = []
    run = JITFunction.run

    def compile_only(self: Any, *arguments: Any, grid: Any, warmup: bool, **options: Any) -> None:
        kernels.append(run(self, *arguments, grid=grid, warmup=True, **options))

    triton.runtime.driver.set_active(NoDevice(capability))
    JITFunction.run = compile_only
    try:
        spec = presets.BY_NAME[preset]
        images = torch.empty(shape, dtype=dtype)
        cells, saved = steps.CELLS.run(images, spec)
        steps.CELLS.vjp(images, saved, cells, spec)
    finally:
        JITFunction.run = run
    return kernels


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", nargs="+", default=["paper", "uoctti", "skimage"], choices=[*presets.BY_NAME])
    parser.add_argument("--size", type=int, default=4096)
    parser.add_argument("--channels", type=int, default=1)
    parser.add_argument("--dtype", default="float32", choices=["uint8", "float16", "bfloat16", "float32", "float64"])
    parser.add_argument("--sm", type=int, nargs="+", default=[80, 90], choices=[*SMS])
    args = parser.parse_args()
    print(f"Triton {triton.__version__}, images of {args.size} x {args.size}, {args.channels} channels, {args.dtype}\n")
    print("| SM | preset | kernel | warps | registers | spilled bytes | shared bytes | occupancy | limit |")
    print("|---:|---|---|---:|---:|---:|---:|---:|---|")
    for capability in args.sm:
        for preset in args.preset:
            shape = 1, args.channels, args.size, args.size
            for kernel in compiled(preset, shape, getattr(torch, args.dtype), capability):
                each = used(kernel, capability)
                share, limit = each.occupancy(SMS[capability])
                print(
                    f"| {capability} | {preset} | `{each.name}` | {each.warps} | {each.registers} | {each.spills} | "
                    f"{each.shared} | {share:.0%} | {limit} |"
                )


if __name__ == "__main__":
    main()
