"""How long are first calls, and calls between other work?

    python benchmarks/first_calls.py [--first] [--cold]

First: in a fresh process with an empty cache, each call after those above it; seconds of CPU and of the clock.  Cold:
milliseconds of a call when other work has taken the caches since the last one, and of calls back to back; medians.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

SIDE = 64
CALLS = {
    "hog": "hog(images, uoctti)",
    "its backward": "hog(images.clone().requires_grad_(), uoctti).sum().backward()",
    "uint8": "hog((255 * images).to(torch.uint8), uoctti)",
    "float64": "hog(images.double(), uoctti)",
    "its backward, float64": "hog(images.double().requires_grad_(), uoctti).sum().backward()",
    "skimage": "hog(images, presets.skimage())",
    "opencv": "hog(torch.rand(1, 3, 128, 64), presets.opencv())",
    "reconstruct": "nablahog.reconstruct(hog(images, uoctti), uoctti, (64, 64), quality='fast')",
    "estimate_pose": "nablahog.estimate_pose(images[0], chairs.chair(0), initial=(0.0, 20.0))",
}
TURNS = 60
WORK = 40_000_000  # numbers that other work reads and writes: 160 MB, more than caches hold


def first() -> None:
    """Prints the times of :data:`CALLS`."""
    import torch

    import nablahog
    from nablahog.datasets import chairs
    from nablahog.hog import hog, presets

    names = {"torch": torch, "nablahog": nablahog, "chairs": chairs, "hog": hog, "presets": presets}
    names |= {"images": torch.rand(1, 1, SIDE, SIDE), "uoctti": presets.uoctti()}
    print("| first call | CPU s | s |\n|---|---:|---:|")
    for name, call in CALLS.items():
        spent, began = time.process_time(), time.perf_counter()
        eval(call, names)
        print(f"| {name} | {time.process_time() - spent:.1f} | {time.perf_counter() - began:.1f} |", flush=True)


def milliseconds(call: Callable[[], object], between: Callable[[], object]) -> float:
    """Median time of a call, with other work between calls."""
    times = []
    for _ in range(TURNS):
        between()
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return 1e3 * statistics.median(times)


def cold() -> None:
    """Prints the times of scikit-image's descriptor of an image of 512 x 512, back to back and between other work."""
    import torch

    from nablahog.hog import hog, presets

    torch.set_num_threads(1)
    spec, images, other = presets.skimage(), torch.rand(1, 1, 512, 512), torch.zeros(WORK)
    print("| 512 x 512, ms | warm | cold |\n|---|---:|---:|")
    for stored in (images, (255 * images).to(torch.uint8), images.double()):

        def call(stored: torch.Tensor = stored) -> object:
            return hog(stored, spec)

        call()
        warm, after_work = milliseconds(call, lambda: None), milliseconds(call, lambda: other.add_(1))
        print(f"| {str(stored.dtype).partition('.')[2]} | {warm:.2f} | {after_work:.2f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", action="store_true", help="first calls only")
    parser.add_argument("--cold", action="store_true", help="cold calls only")
    options = parser.parse_args()
    if options.first or not options.cold:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, __file__, "--in-this-process"]
            subprocess.run(command, env=os.environ | {"NABLAHOG_CACHE_DIR": folder}, check=True)
    if options.cold or not options.first:
        cold()


if __name__ == "__main__":
    first() if sys.argv[1:] == ["--in-this-process"] else main()
