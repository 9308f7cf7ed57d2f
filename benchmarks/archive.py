"""The descriptors of many images as one data set: images a second, memory, and what a kill in between leaves.

    python benchmarks/archive.py [--images 100000] [--folder DIR] [--on "--cluster local:2"] [--kills 1]

Makes JPEG files of 128x128 pixels, describes a part of them in memory for the operator's own speed (one thread, batches
of one), then all by `nablahog hog`, which is killed with SIGKILL so many times and goes on.  Prints the images a second
of both; the memory of all processes of the command, every tenth of the way; and whether each image has one row.
Needs /proc (Linux).
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image

import nablahog
from nablahog.io.descriptor_dataset import DescriptorDataset
from nablahog.io.images import read_image
from resume import descendants

SIDE = 128
A_FOLDER = 10_000
SAMPLE = 1000  # images of the operator's own speed
PAGE = os.sysconf("SC_PAGE_SIZE")


def make_images(folder: Path, count: int) -> None:
    """Smooth noise, which compresses about as photographs do; those that are there are kept."""
    rng = np.random.default_rng(0)
    for number in range(count):
        levels = rng.integers(0, 256, (16, 16), dtype=np.uint8)
        path = folder / f"{number // A_FOLDER:03d}" / f"{number:07d}.jpg"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(levels).resize((SIDE, SIDE), Image.Resampling.BICUBIC).save(path, quality=85)


def own_speed(folder: Path) -> tuple[float, float]:
    """Images a second of one thread: of the operator alone, and with the files read and decoded."""
    torch.set_num_threads(1)
    paths = sorted(folder.glob("*/*.jpg"))[:SAMPLE]
    read_image(paths[0])
    began = time.process_time()
    images = [read_image(path)[None] for path in paths]
    reading = time.process_time() - began
    nablahog.hog(images[0], "uoctti")
    began = time.process_time()
    for image in images:
        nablahog.hog(image, "uoctti")
    computing = time.process_time() - began
    return len(paths) / computing, len(paths) / (computing + reading)


def memory(pid: int) -> float:
    """Gigabytes that a process and those below it have of their own."""
    total = 0
    for each in (pid, *descendants(pid)):
        try:
            _, resident, shared, *_ = map(int, Path(f"/proc/{each}/statm").read_text().split())
        except OSError:
            continue
        total += (resident - shared) * PAGE
    return total / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=100_000)
    parser.add_argument("--folder", type=Path, help="for the images, which are kept")
    parser.add_argument("--on", default="--cluster local:2", help="options of `nablahog hog`")
    parser.add_argument("--kills", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = options.folder or Path(name, "images")
        make_images(folder, options.images)
        alone, read = own_speed(folder)
        print(f"one thread: the operator alone {alone:,.0f} images/s, with files read and decoded {read:,.0f}")
        out = Path(name, "set.parquet")
        described(folder, out, options.on.split(), options.images, options.kills)
        rows = [row.path for row in DescriptorDataset(str(out))]
        size = sum(path.stat().st_size for path in out.iterdir())
        print(
            f"rows {len(rows):,}, different ones {len(set(rows)):,}, {size / 1e9:.2f} GB, files {len([*out.iterdir()])}"
        )
        shutil.rmtree(out)


def described(folder: Path, out: Path, on: list[str], count: int, kills: int) -> None:
    """Runs the command until it ends, through its kills."""
    command = [sys.executable, "-m", "nablahog", "hog", f"{folder}/*/*.jpg", "-o", str(out), "--size", "0", "-q", *on]
    rng = random.Random(0)
    marks = sorted(rng.uniform(0.2, 0.8) for _ in range(kills))
    seconds, tenth = 0.0, 1
    while True:
        began, there = time.monotonic(), len([*out.glob("part-*")])
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        while process.poll() is None:
            time.sleep(0.2)
            share = 1000 * len([*out.glob("part-*")]) / count
            if share >= tenth / 10:
                print(f"{share:.0%}: {memory(process.pid):.2f} GB", flush=True)
                tenth = int(10 * share) + 1
            if marks and share >= marks[0]:
                marks.pop(0)
                process.send_signal(signal.SIGKILL)
                process.wait()
        used = time.monotonic() - began
        seconds += used
        done = len([*out.glob("part-*")]) - there
        print(f"exit status {process.returncode}: {1000 * done:,} images in {used:.1f} s, {1000 * done / used:,.0f}/s")
        if process.returncode == 0:
            break
    print(f"in all: {count / seconds:,.0f} images/s")


if __name__ == "__main__":
    main()
