"""Is the operator as fast as at another revision?  CPU time of two checkouts, by turns.

    git worktree add ../before REVISION
    python benchmarks/revisions.py ../before . [--starts 7] [--cases "float64 paper"]

A ratio is the second checkout's time over the first's: the median over pairs of processes (quartiles), since where a
process lies in memory changes its times by some per cent; of each pair the median of ten turns.  Variables of the
environment reach both processes: NABLAHOG_INSTRUCTIONS=v3 measures AVX2, where it is compiled (docs/kernels.md).  A
case on two threads is timed by the wall.
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
DTYPES = ("float32", "float64", "uint8")
# preset, height, width, pass, images, threads, dtype
CASES = [f"{preset} 256 256 {what} 1 1 float32" for preset in PRESETS for what in ("hog", "vjp", "jvp")]
CASES += [f"{preset} 256 256 {what} 1 1 float64" for preset in PRESETS[:5] for what in ("hog", "vjp")]
CASES += [f"{preset} 256 256 hog 1 1 uint8" for preset in PRESETS[:5]]
CASES += [f"uoctti 16 16 {what} 1 1 float32" for what in ("hog", "both")]
CASES += [f"{preset} 128 64 both 64 1 float32" for preset in PRESETS[:5]]
CASES += ["paper 128 64 both 1 1 float32", "paper 512 512 both 1 1 float32", "uoctti 512 512 both 1 1 float32"]
CASES += [f"{preset} 2048 2048 both 1 2 float32" for preset in ("paper", "uoctti", "skimage")]
CASES += [f"{preset} 128 64 both 64 2 float32" for preset in ("paper", "uoctti", "skimage")]
TURNS, TURN = 10, 0.05  # a turn in seconds


def call(preset: str, height: int, width: int, what: str, batch: int, dtype: str) -> Callable[[], object]:
    """``hog``, its vjp, its jvp, or hog and vjp."""
    import torch

    from nablahog.hog import hog, presets

    bilinear = preset == "vlfeat-bilinear"
    spec = presets.vlfeat(bilinear_orientations=True) if bilinear else getattr(presets, preset)()
    shape = (batch, 1 if spec.colour == "gray" else 3, height, width)
    images = torch.rand(shape, generator=torch.Generator().manual_seed(0))
    images = (255 * images).to(torch.uint8) if dtype == "uint8" else images.to(getattr(torch, dtype))
    if what == "hog":
        return lambda: hog(images, spec)
    if what == "jvp":
        tangents = torch.rand(shape, generator=torch.Generator().manual_seed(2), dtype=images.dtype)
        return lambda: torch.func.jvp(lambda x: hog(x, spec), (images,), (tangents,))
    images.requires_grad_()
    descriptor = hog(images, spec)
    cotangent = torch.rand(descriptor.shape, generator=torch.Generator().manual_seed(1), dtype=images.dtype)
    if what == "vjp":
        return lambda: torch.autograd.grad(descriptor, images, cotangent, retain_graph=True)
    return lambda: torch.autograd.grad(hog(images, spec), images, cotangent)


def serve() -> None:
    """Answers each line of the input, a case, with the milliseconds of a call."""
    import torch

    calls: dict[str, Callable[[], object]] = {}
    for line in sys.stdin:
        preset, height, width, what, batch, threads, dtype = line.split()
        torch.set_num_threads(int(threads))
        clock = time.process_time if threads == "1" else time.perf_counter
        if line not in calls:
            calls[line] = call(preset, int(height), int(width), what, int(batch), dtype)
        calls[line]()
        count, began = 0, clock()
        while clock() - began < TURN:
            calls[line]()
            count += 1
        print(1e3 * (clock() - began) / count, flush=True)


class Checkout:
    """A process that computes with the package of a checkout."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder.resolve() / "src")}
        command = [sys.executable, __file__, "--serve"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        )

    def milliseconds(self, case: str) -> float:
        """Milliseconds of a call."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{case}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs=2, metavar="CHECKOUT")
    parser.add_argument("--starts", type=int, default=7, help="pairs of processes, at least 2")
    parser.add_argument("--cases", default="", help="measure only cases with all these words")
    options = parser.parse_args()
    cases = [case for case in CASES if set(options.cases.split()) <= set(case.split())]
    ratios: dict[str, list[float]] = {case: [] for case in cases}
    for _ in range(options.starts):
        first, second = (Checkout(folder) for folder in options.folders)
        for case in cases:
            turns = [(first.milliseconds(case), second.milliseconds(case)) for _ in range(TURNS + 1)][1:]
            ratios[case].append(statistics.median(after / before for before, after in turns))
        for checkout in (first, second):
            checkout.process.kill()
    print("| preset, height, width, pass, images, threads, dtype | second / first |\n|---|---|")
    for case, some in ratios.items():
        low, middle, high = statistics.quantiles(some, n=4)
        print(f"| {case} | {middle:.2f} ({low:.2f}…{high:.2f}) |")


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["--serve"] else main()
