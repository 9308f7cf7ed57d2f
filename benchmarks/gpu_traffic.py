"""What the plain steps, and a search for pre-images, must take on a GPU: operations and bytes, counted without one.

    python benchmarks/gpu_traffic.py [--size 4096] [--images DIR]

On a GPU each of PyTorch's operations is a kernel, which reads its inputs and writes its results; views cost nothing.
An image is described by the plain steps, forward and with backward, and the bytes are added up, in images.

Then 101 pre-images of 128 x 128 are searched for on a CPU by the rounds that run on a GPU, and operations are counted.
A histogram, a normaliser, or the derivative of one, which is a compiled loop on a CPU, counts as the operations that it
is on a GPU, kernels included; their bytes are left out.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

os.environ["TRITON_INTERPRET"] = "1"  # Triton asks when it is loaded: kernels take images on a CPU

from triton.runtime.interpreter import GridExecutor

from nablahog import hog, presets, reconstruct
from nablahog.hog import HOGSpec
from nablahog.hog.kernels import autograd
from nablahog.hog.triton import steps as triton_steps
from nablahog.invert import objective as preimage_objective
from nablahog.invert import single_scale
from nablahog.optimize import running
from photographs import photographs

PREIMAGES = 101
ALLOCATIONS = ("empty", "empty_like", "empty_strided", "new_empty", "new_empty_strided")


class Traffic(TorchDispatchMode):
    """Counts operations that compute something, and the bytes that they read and write."""

    def __init__(self) -> None:
        super().__init__()
        self.operations = 0
        self.bytes = 0

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        results = function(*args, **(kwargs or {}))
        views = any(each.alias_info is not None and not each.alias_info.is_write for each in function._schema.returns)
        if not views and function.name().split("::")[1].split(".")[0] not in ALLOCATIONS:
            leaves = tree_leaves((args, kwargs, results))
            tensors = {id(leaf): leaf for leaf in leaves if isinstance(leaf, Tensor)}.values()
            self.operations += 1
            # what is expanded has fewer bytes than numbers
            self.bytes += sum(min(tensor.nbytes, tensor.untyped_storage().nbytes()) for tensor in tensors)
        return results


def counted(call: Callable[[], object]) -> Traffic:
    """What a call takes."""
    traffic = Traffic()
    with traffic:
        call()
    return traffic


def describe_image(side: int) -> None:
    """One of zeros, by the plain steps."""
    print("| preset | plain steps | operations | bytes read and written, images |\n|---|---|---:|---:|")
    for name in ("paper", "uoctti", "skimage"):
        spec = presets.BY_NAME[name]
        images = torch.zeros(1, 1, side, side)

        def forward(images: Tensor = images, spec: HOGSpec = spec) -> Tensor:
            return hog(images, spec, backend="torch")

        def both(images: Tensor = images, forward: Callable[[], Tensor] = forward) -> Tensor:
            descriptor = forward()
            return torch.autograd.grad(descriptor, images, torch.ones_like(descriptor))[0]

        for what, call in (("forward", forward), ("with backward", both)):
            images.requires_grad_(what != "forward")
            traffic = counted(call)
            print(f"| `{name}` | {what} | {traffic.operations} | {traffic.bytes / images.nbytes:.0f} |", flush=True)


class Steps:
    """Counts calls of the compiled loops, and knows how many operations each is on a GPU."""

    def __init__(self, spec: HOGSpec) -> None:
        self.operations = 0
        launches = [0]

        def launch(*args: Any, **kwargs: Any) -> None:
            launches[0] += 1

        setattr(GridExecutor, "__call__", launch)  # noqa: B010  (a method)
        images = torch.zeros(1, 1, 32, 32)
        cells = triton_steps.CELLS.run(images, spec)[0]
        for name, argument in (("CELLS", images), ("NORM", cells), ("DESCRIBE", images)):
            on_gpu, on_cpu = getattr(triton_steps, name), getattr(autograd, name)
            output, saved = on_gpu.run(argument, spec)
            calls = {
                "run": partial(on_gpu.run, argument, spec),
                "vjp": partial(on_gpu.vjp, argument, saved, output, spec),
            }
            counting = {}
            for what, call in calls.items():
                before = launches[0]
                of_torch = counted(call).operations
                counting[what] = partial(self._call, getattr(on_cpu, what), of_torch + launches[0] - before)
            setattr(autograd, name, dataclasses.replace(on_cpu, **counting))

    def _call(self, step: Callable[..., Any], operations: int, *args: Any) -> Any:
        self.operations += operations
        return step(*args)


def search_for_preimages(folder: Path | None) -> None:
    """As on a GPU, on a CPU."""
    images = photographs(folder)
    images = images.repeat(-(-PREIMAGES // len(images)), 1, 1, 1)[:PREIMAGES]
    spec = presets.uoctti()
    size = images.shape[2], images.shape[3]
    descriptors = hog(images, spec)
    setattr(running, "dropped_at_once", lambda like: False)  # noqa: B010
    setattr(single_scale, "MEMORY", 2**34)  # noqa: B010  (one part, as on a GPU)
    setattr(preimage_objective, "VOTES", 2**31)  # noqa: B010
    of_steps = Steps(spec)
    traffic = Traffic()
    with traffic:
        result = reconstruct(descriptors, spec, size)
    total = traffic.operations + of_steps.operations
    print(f"\n{PREIMAGES} pre-images of {size[0]} × {size[1]}, distance {float(result.distance.mean()):.3g}:")
    print(f"{total} operations, {of_steps.operations} of them of HOG; {traffic.bytes / 1e9:.0f} GB but for HOG's")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=4096)
    parser.add_argument("--images", type=Path, help="photographs of one size, for pre-images")
    args = parser.parse_args()
    describe_image(args.size)
    search_for_preimages(args.images)


if __name__ == "__main__":
    main()
