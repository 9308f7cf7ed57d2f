"""The largest differences of the kernels to the plain steps, relative to the largest entry, of all dialects.

To the plain steps in the same precision and, of float32, in float64, which those in float32 are compared with as well.

    python -m tests.hog.triton.differences [--root-error 1.28e-7]

Without a GPU Triton's interpreter runs the kernels.  Its reciprocal roots are nearer than those of a GPU: with a
root error, each is off by a random share of up to that.
"""

from __future__ import annotations

import argparse
import os
from typing import Any

import torch
from torch import Tensor

if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")  # Triton asks when it is loaded

import numpy as np

from nablahog.hog.triton import steps

from ..zoo import SPECS, noise
from .test_steps import channels, computed, expected

RESULTS = ("descriptor", "vjp", "jvp")


def differences(name: str, dtype: torch.dtype) -> tuple[tuple[float, ...], ...]:
    """Of descriptor, vjp and jvp, of an image of 15 x 13 pixels of noise: kernels and plain, kernels and exact, plain
    and exact.
    """
    x, s = noise(1, channels(SPECS[name]), 15, 13, dtype=dtype), SPECS[name]
    kernels, plain = computed(steps.DESCRIBE, x, s), expected(steps.DESCRIBE, x, s)
    exact = expected(steps.DESCRIBE, x.double(), s)

    def between(results: tuple[Tensor, ...], others: tuple[Tensor, ...]) -> tuple[float, ...]:
        pairs = zip(results, others, strict=True)
        return tuple(float((a.double() - b).abs().max() / b.abs().max()) for a, b in pairs)

    return between(kernels, plain), between(kernels, exact), between(plain, exact)


def inexact_roots(error: float) -> None:
    """From now on the interpreter's reciprocal roots of float32 are off by up to this, relative to them."""
    from triton.runtime.interpreter import InterpreterBuilder, TensorHandle

    generator, nearest = np.random.default_rng(0), InterpreterBuilder.create_rsqrt

    def create_rsqrt(builder: Any, argument: Any) -> Any:
        root = nearest(builder, argument)
        off = 1 + error * generator.uniform(-1, 1, root.data.shape)
        return TensorHandle((root.data * off).astype(root.data.dtype), root.dtype)

    InterpreterBuilder.create_rsqrt = create_rsqrt


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root-error", type=float, default=0.0)
    error = parser.parse_args().root_error
    if error:
        inexact_roots(error)
    exact = [name for name in SPECS if SPECS[name].angle != "vlfeat"]
    others = [name for name in SPECS if name not in exact]
    print(f"| dialects | difference | {' | '.join(RESULTS)} |\n|---|---|---:|---:|---:|")
    with np.errstate(all="ignore"):
        for what, names in ((f"{len(exact)}", exact), (f"{len(others)} with VLFeat's angle", others)):
            for dtype in (torch.float32, torch.float64):
                largest = np.max([differences(name, dtype) for name in names], axis=0)
                short = str(dtype)[6:]
                pairs = [f"kernels and plain steps, {short}"]
                if dtype == torch.float32:
                    pairs += ["kernels in float32 and plain steps in float64", "plain steps, float32 and float64"]
                for pair, values in zip(pairs, largest, strict=False):
                    print(f"| {what} | {pair} | {' | '.join(f'{value:.1e}' for value in values)} |", flush=True)


if __name__ == "__main__":
    main()
