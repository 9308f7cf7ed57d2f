"""The largest differences of the kernels to the plain steps, relative to the largest entry, of all dialects.

To the plain steps in the same precision and, of float32, in float64, which those in float32 are compared with as well.

    python -m tests.hog.triton.differences

Without a GPU Triton's interpreter runs the kernels.
"""

from __future__ import annotations

import os

import torch
from torch import Tensor

if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")  # Triton asks when it is loaded

import numpy as np

from ..zoo import SPECS, noise
from .test_steps import channels, computed, expected

RESULTS = ("cells", "vjp")


def differences(name: str, dtype: torch.dtype) -> tuple[tuple[float, ...], ...]:
    """Of cells and vjp, of an image of 15 x 13 pixels of noise: kernels and plain, kernels and exact, plain
    and exact.
    """
    x, s = noise(1, channels(SPECS[name]), 15, 13, dtype=dtype), SPECS[name]
    kernels, plain = computed(x, s), expected(x, s)
    exact = expected(x.double(), s)

    def between(results: tuple[Tensor, ...], others: tuple[Tensor, ...]) -> tuple[float, ...]:
        pairs = zip(results, others, strict=True)
        return tuple(float((a.double() - b).abs().max() / b.abs().max()) for a, b in pairs)

    return between(kernels, plain), between(kernels, exact), between(plain, exact)


def main() -> None:
    exact = [name for name in SPECS if SPECS[name].angle != "vlfeat"]
    others = [name for name in SPECS if name not in exact]
    print(f"| dialects | difference | {' | '.join(RESULTS)} |\n|---|---|---:|---:|")
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
