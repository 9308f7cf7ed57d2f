"""How close do pre-images come to photographs, what do they cost, and how does that compare with other searches?

    python benchmarks/preimages.py [--images DIR] [--quality fast best] [--peers 4] [--threads 1]

Means of CC, MI, SSIM and the descriptor distance (``nablahog.metrics.DEFINITIONS``) over the images of a folder, of
128x128 pixels, with their 95 % bootstrap intervals, and the CPU time of `reconstruct` on the whole batch, divided by
the number of images.  ``--peers``: this many images are inverted one by one in turns, also by CNN-HOG's schedule of
800 steps and by the paper's own search.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from skimage import data
from torch import Tensor
from torch.nn.functional import interpolate

from nablahog import hog, metrics, presets, reconstruct
from nablahog.hog import HOGSpec
from nablahog.hog.gradient import gray
from nablahog.invert import AsPublished, Search
from nablahog.io.images import read_image
from nablahog.paper.baselines.cnn_hog import CNNHOG
from timing import Times, cell, ratio, summary, table, times_as_fast

SIDE = 128
SUFFIXES = {".png", ".jpg", ".jpeg", ".webp"}
SAMPLES = ("camera", "astronaut", "coffee", "coins", "chelsea", "clock", "rocket", "brick")
FIGURES: dict[str, Callable[[Tensor, Tensor], float]] = {
    "CC": metrics.cross_correlation,
    "MI": metrics.mutual_information,
    "SSIM": metrics.ssim,
}


def photographs(folder: Path | None, side: int = SIDE) -> Tensor:
    """(N, 1, side, side) in 0…1: squares of those images of a folder, or of scikit-image's, that are so large."""
    if folder is not None:
        files = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
        pictures = [gray(read_image(file)[None]) for file in files]
    else:
        samples = (torch.from_numpy(np.atleast_3d(getattr(data, name)())) for name in SAMPLES)
        pictures = [gray(picture.permute(2, 0, 1)[None] / 255) for picture in samples]
    images = []
    for picture in pictures:
        shorter = min(picture.shape[2:])
        if shorter >= side:
            images.append(interpolate(picture[..., :shorter, :shorter], size=(side, side), mode="area"))
    return torch.cat(images)


def pre_images(
    images: Tensor, preset: HOGSpec | str = "uoctti", **choices: Any
) -> tuple[dict[str, list[float]], float]:
    """The figures of each image, and the seconds of the processor for one."""
    size, descriptors = (images.shape[2], images.shape[3]), hog(images, preset)
    reconstruct(descriptors[:1], preset, size, search=Search(max_evaluations=3))  # what runs first is slower
    began = time.process_time()
    result = reconstruct(descriptors, preset, size, **choices)
    seconds = (time.process_time() - began) / len(images)
    pairs = list(zip(result.image[:, 0], images[:, 0], strict=True))
    figures = {name: [figure(*pair) for pair in pairs] for name, figure in FIGURES.items()}
    figures |= {"distance": result.distance.tolist(), "evaluations": result.evaluations.double().tolist()}
    return figures, seconds


def by_size(folder: Path | None, sizes: list[int], cells: list[int]) -> str:
    """CC, MI and SSIM by the size of images and cells, with the prior and without."""
    rows = []
    for side, cell_size in product(sizes, cells):
        images = photographs(folder, side)
        figures = []
        for prior in ("default", None):
            each, seconds = pre_images(images, presets.uoctti(cell_size), prior=prior)
            figures.append(" / ".join(f"{np.mean(each[name]):.3f}" for name in FIGURES) + f", {seconds:.1f} s")
        rows.append([f"{side}x{side}", str(cell_size), str(len(images)), *figures])
    return table(["image", "cells", "n", "prior: CC / MI / SSIM, CPU", "no prior"], rows)


def beside_others(images: Tensor, qualities: list[str]) -> str:
    """A table of ours and of others, in turns."""
    spec, networks = presets.uoctti(), {"CNN-HOG": CNNHOG(), "CNN-HOGb": CNNHOG(bilinear=True)}

    def cnn_hog(network: CNNHOG, image: Tensor) -> Tensor:
        return network.reconstruct(network.descriptor(image)).image

    def ours(image: Tensor, **choices: Any) -> Tensor:
        return reconstruct(hog(image, spec), spec, **choices).image

    methods: dict[str, Callable[[Tensor], Tensor]] = {
        **{f"ours, {quality}": partial(ours, quality=quality) for quality in qualities},
        **{name: partial(cnn_hog, network) for name, network in networks.items()},
        "paper": partial(ours, method=AsPublished()),
    }
    times = {name: Times() for name in methods}
    cc: dict[str, list[float]] = {name: [] for name in methods}
    for image in images.split(1):
        for name, method in methods.items():
            made: list[Tensor] = []
            times[name].add(partial(lambda method, image, made: made.append(method(image)), method, image, made))
            cc[name].append(metrics.cross_correlation(made[0][0, 0], image[0, 0]))
    rows = []
    for name in methods:
        peers = [each for each in methods if not each.startswith("ours")] if name.startswith("ours") else []
        beside = (f"{times_as_fast(ratio(times[peer].cpu, times[name].cpu))} {peer}" for peer in peers)
        seconds = summary([ms / 1000 for ms in times[name].cpu])
        rows.append([name, cell(seconds), f"{np.mean(cc[name]):.3f}", ", ".join(beside) or "–"])
    return table(["one by one", "CPU s an image", "CC", "times as fast as"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, metavar="DIR", help="by default scikit-image's, at 128x128")
    parser.add_argument("--preset", default="uoctti")
    parser.add_argument("--quality", nargs="+", default=["fast", "best"])
    parser.add_argument("--every", type=int, default=1, help="take every N-th image only")
    parser.add_argument("--peers", type=int, default=0, help="how many images the other methods invert, too")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--sizes", type=int, nargs="+", metavar="PIXELS", help="table by size instead")
    parser.add_argument("--cells", type=int, nargs="+", metavar="PIXELS", default=[4, 8, 16])
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    if options.sizes:
        print(by_size(options.images, options.sizes, options.cells))
        return
    images = photographs(options.images)[:: options.every]
    print(f"{len(images)} images of {images.shape[3]}x{images.shape[2]}, {options.preset}, {options.threads} threads\n")
    generator, rows = np.random.default_rng(0), []
    for quality in options.quality:
        figures, seconds = pre_images(images, options.preset, quality=quality)
        cells = []
        for name in (*FIGURES, "distance"):
            means = generator.choice(figures[name], (10_000, len(images))).mean(1)
            low, high = np.quantile(means, (0.025, 0.975))
            cells.append(f"{np.mean(figures[name]):.3f} ({low:.3f}…{high:.3f})")
        rows.append([quality, *cells, f"{np.mean(figures['evaluations']):.0f}", f"{seconds:.3f}"])
    print(table(["quality", *FIGURES, "distance", "evaluations", "CPU s"], rows), flush=True)
    if options.peers:
        some = images[:: max(1, len(images) // options.peers)][: options.peers]
        print(f"\n{beside_others(some, options.quality)}")


if __name__ == "__main__":
    main()
