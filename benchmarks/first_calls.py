"""How long are first calls?

    python benchmarks/first_calls.py

In a fresh process with an empty cache, each call after those above it; seconds of CPU and of the clock.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time

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


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, "--in-this-process"]
        subprocess.run(command, env=os.environ | {"NABLAHOG_CACHE_DIR": folder}, check=True)


if __name__ == "__main__":
    first() if sys.argv[1:] == ["--in-this-process"] else main()
