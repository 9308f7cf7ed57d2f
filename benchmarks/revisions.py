"""Is the operator as fast as at another revision?  CPU time of two checkouts, by turns, in one thread.

    git worktree add ../before REVISION
    python benchmarks/revisions.py ../before . [--starts 7]

A ratio is the second checkout's time over the first's: the median over pairs of processes (quartiles), since where a
process lies in memory changes its times by some per cent; of each pair the median of ten turns.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

PRESETS = ("paper", "uoctti", "skimage", "opencv", "dpm", "vlfeat", "vlfeat-bilinear")
CASES = [f"{preset} 256 {what} 1" for preset in PRESETS for what in ("hog", "vjp")]
CASES += ["paper 128 both 1", "paper 128 both 64", "paper 512 both 1"]
TURNS, TURN = 10, 0.05  # a turn in seconds


def call(preset: str, side: int, what: str, batch: int) -> Callable[[], object]:
    """``hog``, its vjp, or both, of float32 images."""
    import torch

    from nablahog.hog import hog, presets

    torch.set_num_threads(1)
    bilinear = preset == "vlfeat-bilinear"
    spec = presets.vlfeat(bilinear_orientations=True) if bilinear else getattr(presets, preset)()
    channels = 1 if spec.colour == "gray" else 3
    images = torch.rand(batch, channels, side, side, generator=torch.Generator().manual_seed(0))
    if what == "hog":
        return lambda: hog(images, spec)
    images.requires_grad_()
    descriptor = hog(images, spec)
    cotangent = torch.rand(descriptor.shape, generator=torch.Generator().manual_seed(1))
    if what == "vjp":
        return lambda: torch.autograd.grad(descriptor, images, cotangent, retain_graph=True)
    return lambda: torch.autograd.grad(hog(images, spec), images, cotangent)


def serve() -> None:
    """Answers each line of the input, a case, with the CPU milliseconds of a call."""
    calls: dict[str, Callable[[], object]] = {}
    for line in sys.stdin:
        preset, side, what, batch = line.split()
        if line not in calls:
            calls[line] = call(preset, int(side), what, int(batch))
        calls[line]()
        count, began = 0, time.process_time()
        while time.process_time() - began < TURN:
            calls[line]()
            count += 1
        print(1e3 * (time.process_time() - began) / count, flush=True)


class Checkout:
    """A process that computes with the package of a checkout."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder.resolve() / "src")}
        command = [sys.executable, __file__, "--serve"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        )

    def milliseconds(self, case: str) -> float:
        """Of a call."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{case}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs=2, metavar="CHECKOUT")
    parser.add_argument("--starts", type=int, default=7, help="pairs of processes, at least 2")
    options = parser.parse_args()
    ratios: dict[str, list[float]] = {case: [] for case in CASES}
    for _ in range(options.starts):
        first, second = (Checkout(folder) for folder in options.folders)
        for case in CASES:
            turns = [(first.milliseconds(case), second.milliseconds(case)) for _ in range(TURNS + 1)][1:]
            ratios[case].append(statistics.median(after / before for before, after in turns))
        for checkout in (first, second):
            checkout.process.kill()
    print("| preset, side, what, batch | second / first |\n|---|---|")
    for case, some in ratios.items():
        low, middle, high = statistics.quantiles(some, n=4)
        print(f"| {case} | {middle:.2f} ({low:.2f}…{high:.2f}) |")


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["--serve"] else main()
