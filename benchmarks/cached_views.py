"""What do views of models on disk save, where many models are compared with a photograph?

    python benchmarks/cached_views.py [--models 90] [--photographs 5] [--threads 2]

Two processes, one after the other, compare the same procedural chairs with photographs of some of them, whose box is
known and nothing else.  The first begins with an empty folder for views.  Seconds are those of `estimate_pose`, wall
time and, in brackets, that of all processors; making the meshes and compiling do not count.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import torch

from nablahog.paper.chairs import chair
from nablahog.pose import estimate_pose
from nablahog.render import Camera, pose, render


def seconds(models: int, photographs: int, threads: int) -> list[tuple[float, float]]:
    """Wall time and that of all processors for each photograph, in this process."""
    torch.set_num_threads(threads)
    meshes = {str(seed): chair(seed) for seed in range(models)}
    estimate_pose(torch.rand(1, 100, 100), chair(models), box=(10, 10, 90, 90), initial=(0, 10))  # compiles
    times = []
    for k in range(photographs):
        image = render(meshes[str(k)], pose(40 + 50 * k, 15, 2.8), Camera(300.0, 150, 180))[0]
        rows, cols = (image[0] < 1).nonzero().unbind(1)
        box = [float(side) for side in (cols.min(), rows.min(), cols.max() + 1, rows.max() + 1)]
        began = time.perf_counter(), time.process_time()
        estimate_pose(image, meshes, box=box)
        times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=int, default=90)
    parser.add_argument("--photographs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(seconds(options.models, options.photographs, options.threads)))
        return
    print("| process | first photograph, s | others, s |\n|---|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        sizes = [f"--{name}={getattr(options, name)}" for name in ("models", "photographs", "threads")]
        environment = {**os.environ, "NABLAHOG_CACHE_DIR": folder}
        for name in ("empty folder", "views on disk"):
            child = subprocess.run(
                [sys.executable, __file__, "--child", *sizes],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            first, *others = (f"{wall:.2f} ({processors:.2f})" for wall, processors in json.loads(child.stdout))
            print(f"| {name} | {first} | {', '.join(others)} |", flush=True)
        size = sum(path.stat().st_size for path in Path(folder, "views").iterdir())
    print(f"\n{size / 1e6:.0f} MB on disk")


if __name__ == "__main__":
    main()
