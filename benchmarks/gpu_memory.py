"""What the operator allocates on a GPU, counted without one: kernels are not run, and allocations are those of a CPU.

    python benchmarks/gpu_memory.py [--size 4096]

The most that is held during a call beyond the images, in MiB and in images.  The result is part of it, and with the
backward pass the descriptor and its gradient, which the caller holds.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from itertools import accumulate

import torch
from torch import Tensor
from torch.profiler import ProfilerActivity, profile

os.environ["TRITON_INTERPRET"] = "1"  # Triton asks when it is loaded: the backend takes images on a CPU

from triton.runtime.interpreter import GridExecutor

from nablahog import hog, presets
from nablahog.hog import HOGSpec

MIB = 2**20


def peak(call: Callable[[], object]) -> int:
    """Bytes that are held at most during a call, beyond those before it."""
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as profiler:
        call()
    assert profiler.profiler is not None
    results = profiler.profiler.kineto_results
    changes = sorted((e.start_ns(), e.nbytes()) for e in results.events() if e.name() == "[memory]")
    most: int = max(accumulate(change for _, change in changes))
    return most


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=4096)
    side = parser.parse_args().size
    setattr(GridExecutor, "__call__", lambda *_, **__: None)  # noqa: B010  (a method)
    colour = {"skimage": presets.skimage(channel_axis=-1)}
    print("| preset | images | dtype | descriptor, MiB | forward, MiB | images | with backward, MiB | images |")
    print("|---|---|---|---:|---:|---:|---:|---:|")
    for name in ("paper", "uoctti", "skimage"):
        for channels in (1, 3):
            spec = presets.BY_NAME[name] if channels == 1 else colour.get(name, presets.BY_NAME[name])
            for dtype in (torch.float32, torch.uint8):
                images = torch.zeros(1, channels, side, side, dtype=dtype)

                def describe(images: Tensor = images, spec: HOGSpec = spec) -> Tensor:
                    return hog(images, spec, backend="triton")

                def both(images: Tensor = images, describe: Callable[[], Tensor] = describe) -> Tensor:
                    descriptor = describe()
                    return torch.autograd.grad(descriptor, images, torch.ones_like(descriptor))[0]

                descriptor = describe().nbytes  # and makes the tables, which are kept
                spent = [peak(describe)]
                if dtype.is_floating_point:
                    images.requires_grad_()
                    both()
                    spent.append(peak(both))
                cells = " | ".join(f"{each / MIB:.0f} | {each / images.nbytes:.2f}" for each in spent)
                rest = "" if dtype.is_floating_point else " | |"
                print(f"| {name} | {channels} × {side}² | {str(dtype)[6:]} | {descriptor / MIB:.0f} | {cells} |{rest}")


if __name__ == "__main__":
    main()
