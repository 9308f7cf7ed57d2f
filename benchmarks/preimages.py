"""How close single-scale pre-images come to a folder of photographs, and what they cost.

    python benchmarks/preimages.py --images DIR [--quality best] [--descriptor uoctti] [--cell 8] [--every N]

Every image is read as gray (Eq. 1) and must be of one size.  Prints mean and median of CC, MI, SSIM and the descriptor
distance as `nablahog.metrics.DEFINITIONS` defines them, a 95 % bootstrap interval of each mean, and the wall time and
the CPU time of `reconstruct` on the whole batch, divided by the number of images, once all its loops are compiled.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import get_args

import numpy as np
import torch

from nablahog import hog, metrics, presets, reconstruct
from nablahog.hog.gradient import gray
from nablahog.invert import Search
from nablahog.invert.quality import QualityName
from nablahog.io.images import read_image


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, required=True, help="folder of images of one size")
    parser.add_argument("--descriptor", choices=("uoctti", "paper"), default="uoctti")
    parser.add_argument("--cell", type=int, default=8)
    parser.add_argument("--quality", choices=get_args(QualityName), default="best")
    parser.add_argument("--every", type=int, default=1, help="only every N-th image")
    parser.add_argument("--limit", type=int, default=None, help="only the first N images")
    parser.add_argument(
        "--max-evaluations", type=int, default=None, help="of each image; the library's default if absent"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--json", type=Path, help="write the figures of each image to this file, too")
    options = parser.parse_args()

    torch.set_num_threads(options.threads)
    files = sorted(p for p in options.images.iterdir() if p.suffix.lower() in {".png", ".jpg", ".jpeg"})
    files = files[: options.limit][:: options.every]
    images = torch.stack([gray(read_image(file)[None])[0] for file in files])
    spec = getattr(presets, options.descriptor)(options.cell)
    size, descriptors = (images.shape[2], images.shape[3]), hog(images, spec)
    reconstruct(descriptors[:1], spec, size, search=Search(max_evaluations=3))
    began = time.process_time()
    result = reconstruct(
        descriptors,
        spec,
        size,
        quality=options.quality,
        seed=options.seed,
        search=Search(max_evaluations=options.max_evaluations),
    )
    spent = (time.process_time() - began) / len(files)

    rows = []
    for i, file in enumerate(files):
        pair = result.image[i, 0], images[i, 0]
        figures = {"CC": metrics.cross_correlation(*pair), "MI": metrics.mutual_information(*pair)}
        figures |= {"|CC|": abs(figures["CC"]), "SSIM": metrics.ssim(*pair), "distance": float(result.distance[i])}
        rows.append({"image": file.name, **figures, "evaluations": int(result.evaluations[i])})

    print(f"{len(files)} images of {images.shape[-2]}x{images.shape[-1]}, {spec.name}, cell {options.cell}")
    print("| figure | mean | 95 % interval | median |\n| --- | --- | --- | --- |")
    generator = np.random.default_rng(0)
    for name in ("CC", "|CC|", "MI", "SSIM", "distance"):
        values = np.array([row[name] for row in rows], dtype=float)
        means = generator.choice(values, (10_000, len(values))).mean(1)
        low, high = np.quantile(means, (0.025, 0.975))
        print(f"| {name} | {values.mean():.4f} | {low:.4f} … {high:.4f} | {np.median(values):.4f} |")
    evaluations = np.mean([row["evaluations"] for row in rows])
    seconds = result.seconds / len(files)
    print(
        f"{seconds:.3f} s, {spent:.3f} s of CPU and {evaluations:.0f} evaluations an image, {options.threads} threads"
    )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
