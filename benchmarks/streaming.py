"""CPU time and memory of a large image's descriptor, whole and in strips, as a Markdown table (Linux only: VmHWM).

Each is computed in a process of its own, which has described a small image before, from a file that is mapped.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from nablahog.hog import hog, presets, stream

WHOLE = 0
MEMORIES = (WHOLE, 2**26, 2**28)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--size", type=int, default=20_000, help="pixels of either side (default: 20000)")
    arguments.add_argument("--presets", nargs="+", default=["uoctti", "paper"], help="(default: uoctti paper)")
    arguments.add_argument("--one", nargs=3, help=argparse.SUPPRESS, metavar=("FILE", "PRESET", "MEMORY"))
    given = arguments.parse_args()
    if given.one is not None:
        measure(Path(given.one[0]), given.one[1], int(given.one[2]))
        return
    size = given.size
    print(f"{size}x{size} pixels of noise, uint8: {size**2 / 2**20:.0f} MiB; one of {os.cpu_count()} cores.\n")
    print("| preset | memory | strips | CPU s | process before, MiB | peak, MiB | the same |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.npy"
        write(path, size)
        for name in given.presets:
            digests = set()
            for memory in MEMORIES:
                command = [sys.executable, __file__, "--one", str(path), name, str(memory)]
                run = subprocess.run(command, capture_output=True, text=True, check=True)
                *figures, digest = run.stdout.split()
                digests.add(digest)
                what = "whole" if memory == WHOLE else f"{memory / 2**20:.0f} MiB"
                print(f"| {name} | {what} | {' | '.join(figures)} | {len(digests) == 1} |", flush=True)


def write(path: Path, size: int) -> None:
    random = np.random.default_rng(0)
    image = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=(size, size))
    for row in range(0, size, 500):
        some = image[row : row + 500]
        some[:] = random.integers(0, 256, some.shape, dtype=np.uint8)


def peak() -> float:
    """MiB."""
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in status if line.startswith("VmHWM")).split()[1]) / 1024


def measure(path: Path, name: str, memory: int) -> None:
    """Prints the strips, seconds, both peaks and a hash of the descriptor."""
    torch.set_num_threads(1)
    spec = getattr(presets, name)()

    def parts(image: np.ndarray) -> Iterator[np.ndarray]:
        if memory != WHOLE:
            return (strip.descriptor for strip in stream(image, spec, memory=memory))
        return iter([hog(torch.from_numpy(np.array(image))[None, None], spec)[0].numpy()])

    for _ in parts(np.zeros((64, 64), np.uint8)):
        pass
    before, started, digest, strips = peak(), time.process_time(), hashlib.sha256(), 0
    seconds = 0.0
    for part in parts(np.load(path, mmap_mode="r")):
        seconds += time.process_time() - started
        strips += 1
        digest.update(part.data)  # which takes a while, too
        started = time.process_time()
    print(strips, f"{seconds:.1f} {before:.0f} {peak():.0f}", digest.hexdigest())


if __name__ == "__main__":
    main()
