"""What do first calls cost in a fresh process, beyond ``import torch``?

    python benchmarks/first_calls.py [--starts 5]

CPU seconds, one thread: medians over fresh processes.  Each call comes after those above it, and is called twice.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time

from timing import processor, table

IMPORT = "import nablahog"
CALLS = {
    "`hog`": "hog(images, uoctti)",
    "its backward": "hog(images.clone().requires_grad_(), uoctti).sum().backward()",
    "of bytes": "hog((255 * images).to(torch.uint8), uoctti)",
    "of float64, with backward": "hog(images.double().requires_grad_(), uoctti).sum().backward()",
    "of scikit-image": "hog(images, presets.skimage())",
    "of OpenCV": "hog(torch.rand(1, 3, 128, 64), presets.opencv())",
    "`reconstruct`": "nablahog.reconstruct(hog(images, uoctti), uoctti, (64, 64), quality='fast')",
    "`estimate_pose`": "nablahog.estimate_pose(images[0], chairs['wooden-0'], initial=(0.0, 20.0))",
}


def measure() -> None:
    """Prints the seconds of the first and the second call of each, of this process."""
    import torch

    torch.set_num_threads(1)
    names = {"torch": torch, "images": torch.rand(1, 1, 64, 64)}

    def seconds(statement: str) -> float:
        began = time.process_time()
        exec(statement, names)
        return time.process_time() - began

    print(seconds(f"{IMPORT}; from nablahog import hog, presets; uoctti = presets.uoctti()"), seconds(IMPORT))
    exec("chairs = nablahog.sample_chairs()", names)
    for statement in CALLS.values():
        print(seconds(statement), seconds(statement))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=5, help="processes")
    starts = parser.parse_args().starts
    # views of models that an earlier process has stored would not be drawn
    environment = os.environ | {"OMP_NUM_THREADS": "1", "NABLAHOG_CACHE_SIZE": "0"}
    command = [sys.executable, __file__, "--measure"]
    printed = [subprocess.run(command, env=environment, check=True, stdout=-1, text=True).stdout for _ in range(starts)]
    runs = [[tuple(map(float, line.split())) for line in text.splitlines()] for text in printed]
    rows = []
    for name, *pairs in zip([f"`{IMPORT}`", *CALLS], *runs, strict=True):
        first, second = (statistics.median(values) for values in zip(*pairs, strict=True))
        rows.append([name, f"{first:.3f}", f"{second:.3f}"])
    print(f"{processor()}\n\n{table(['call', 'first, CPU s', 'second, CPU s'], rows)}")


if __name__ == "__main__":
    measure() if sys.argv[1:] == ["--measure"] else main()
