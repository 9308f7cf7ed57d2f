"""What each own vector routine of the kernels gains over a plain Numba loop, in the operator call that uses it.

    python benchmarks/vector_routines.py [ROUTINE ...] [--seconds S]

For each routine two processes take turns: one with the kernels as they are, one with the loop of plain_loops.py in the
routine's place.  Each times `hog`, or its derivative, of one float32 image of 256 x 256 in one thread by CPU time.  A
gain is the ratio of two neighbouring turns: median (quartiles).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module

import numpy as np

SIDE = 256
TURN = 0.1  # seconds


@dataclass(frozen=True)
class Case:
    """A routine, or several that do one thing, and an operator call that uses it.

    Attributes:
        replaced: functions, each with the kernel modules that call it by its name.
        spec: name of a preset; it must use the routine, with these ``options``.
        vjp: whether the call is hog's vjp.
    """

    replaced: dict[str, tuple[str, ...]]
    spec: str
    vjp: bool = False
    options: dict[str, bool] = field(default_factory=dict)


_BLOCKS: dict[str, tuple[str, ...]] = dict.fromkeys(
    ("add", "clipped", "clipped_norm_vjp", "copy", "copy_scaled", "dot", "norm_vjp", "read_line"), ("block_norms",)
)
_FOUR_BLOCKS = {
    **dict.fromkeys(("clipped", "clipped_totals", "dot", "half_sums"), ("four_blocks",)),
    **dict.fromkeys(("add_scaled", "clipped_vjp"), ("four_blocks_vjp",)),
    **dict.fromkeys(("copy", "read_line"), ("four_blocks", "four_blocks_vjp")),
    "read_folded": ("four_blocks",),
}
CASES = {
    "linear_votes": Case({"single_votes": ("votes",)}, "paper"),
    "vlfeat_votes": Case({"vlfeat_votes": ("votes",)}, "vlfeat", options={"bilinear_orientations": True}),
    "nearest_votes": Case({"nearest_votes": ("votes",)}, "dpm"),
    "begun_votes": Case({"begun_votes": ("votes",)}, "skimage"),
    "sum_votes": Case({"sum_up": ("cells",)}, "paper"),
    "pool_eight": Case({"pool": ("cells", "cells_jvp")}, "paper"),
    "read_votes": Case({"votes_gradient": ("cells_vjp",)}, "paper", vjp=True),
    "block_norm": Case(_BLOCKS, "skimage"),
    "block_norm_of_18": Case(_BLOCKS, "opencv"),
    "block_norm_vjp": Case(_BLOCKS, "opencv", vjp=True),
    "four_blocks": Case(_FOUR_BLOCKS, "uoctti"),
    "four_blocks_vjp": Case(_FOUR_BLOCKS, "uoctti", vjp=True),
    "look_up": Case({"fits": ("parameters",)}, "paper", vjp=True),  # beside read_votes; 1 without AVX-512
}


def call(case: Case) -> Callable[[], object]:
    """The operator call of a case."""
    import torch

    from nablahog.hog import hog, presets

    torch.set_num_threads(1)
    spec = getattr(presets, case.spec)(**case.options)
    channels = 1 if spec.colour == "gray" else 3
    images = torch.rand(1, channels, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    if not case.vjp:
        return lambda: hog(images, spec)
    images.requires_grad_()
    descriptor = hog(images, spec)
    cotangent = torch.rand(descriptor.shape, generator=torch.Generator().manual_seed(1))
    return lambda: torch.autograd.grad(descriptor, images, cotangent, retain_graph=True)


def serve(name: str, plain: bool) -> None:
    """Answers each line of the input with the CPU milliseconds of a call."""
    case = CASES[name]
    if plain:
        loops = import_module("plain_loops")
        for function, modules in case.replaced.items():
            for module in modules:
                home = import_module(f"nablahog.hog.kernels.{module}")
                assert hasattr(home, function), (module, function)
                setattr(home, function, getattr(loops, function))
    run = call(case)
    run()
    print("ready", flush=True)
    for _ in sys.stdin:
        run()
        start, calls = time.process_time(), 0
        while time.process_time() < start + TURN:
            run()
            calls += 1
        print(1e3 * (time.process_time() - start) / calls, flush=True)


def _turn(server: subprocess.Popen[str]) -> float:
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write("\n")
    server.stdin.flush()
    return float(server.stdout.readline())


def measure(name: str, seconds: float) -> None:
    """Prints one line of the table."""
    servers = []
    for plain in (False, True):
        command = [sys.executable, __file__, "--serve", name, *(["--plain"] if plain else [])]
        server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        assert server.stdout.readline() == "ready\n"
        servers.append(server)
    times: list[list[float]] = []
    end = time.perf_counter() + seconds
    while len(times) < 5 or time.perf_counter() < end:
        times.append([_turn(server) for server in servers])
    for server in servers:
        server.terminate()
    ours, plain_ = np.array(times).T
    low, median, high = np.quantile(plain_ / ours, (0.25, 0.5, 0.75))
    case = CASES[name]
    what = f"{case.spec}{', vjp' if case.vjp else ''}"
    print(
        f"| {name} | {what} | {np.median(plain_):.3f} | {np.median(ours):.3f} | {median:.2f} ({low:.2f}…{high:.2f}) |",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("routines", nargs="*", metavar="ROUTINE", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--seconds", type=float, default=6.0, help="for each routine")
    parser.add_argument("--serve", choices=CASES, help=argparse.SUPPRESS)
    parser.add_argument("--plain", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve, options.plain)
        return
    print("| routine | call | plain ms | ms | gain |\n|---|---|---:|---:|---:|")
    for name in options.routines or CASES:
        measure(name, options.seconds)


if __name__ == "__main__":
    main()
