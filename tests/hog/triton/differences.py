"""The largest differences of the kernels to the plain steps, relative to the largest entry, of all dialects.

    python -m tests.hog.triton.differences

Without a GPU Triton's interpreter runs the kernels.
"""

from __future__ import annotations

import os

import torch

if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")  # Triton asks when it is loaded

import numpy as np

from nablahog.hog.triton import steps

from ..zoo import SPECS, noise
from .test_steps import channels, computed, expected

RESULTS = ("descriptor", "vjp", "jvp")


def differences(name: str, dtype: torch.dtype) -> tuple[float, ...]:
    """Of descriptor, vjp and jvp, of an image of 15 x 13 pixels of noise."""
    x, s = noise(1, channels(SPECS[name]), 15, 13, dtype=dtype), SPECS[name]
    pairs = zip(computed(steps.DESCRIBE, x, s), expected(steps.DESCRIBE, x, s), strict=True)
    return tuple(float((got - plain).abs().max() / plain.abs().max()) for got, plain in pairs)


def main() -> None:
    exact = [name for name in SPECS if SPECS[name].angle != "vlfeat"]
    others = [name for name in SPECS if name not in exact]
    print(f"| dialects | dtype | {' | '.join(RESULTS)} |\n|---|---|---:|---:|---:|")
    with np.errstate(all="ignore"):
        for what, names in ((f"{len(exact)}", exact), (f"{len(others)} with VLFeat's angle", others)):
            for dtype in (torch.float32, torch.float64):
                largest = np.max([differences(name, dtype) for name in names], axis=0)
                print(f"| {what} | {str(dtype)[6:]} | {' | '.join(f'{value:.1e}' for value in largest)} |", flush=True)


if __name__ == "__main__":
    main()
