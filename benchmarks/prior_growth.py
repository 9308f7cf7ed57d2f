"""Are more photographs to learn from, or more weights, worth having for a prior of unsigned descriptors?

    python benchmarks/prior_growth.py --images TRAIN --test DIR [--steps N] [--counts N ...] [--weights NAME ...]

Trains priors from 808, 2,000 and all photographs, and with about 1, 4 and 8 million weights, all for the same number of
steps, and prints how like the photographs of another folder their own answers are, without any search: the mean
correlation (CC), that of the likelier of the answer and its negative (|CC|), and the share that is no negative.
Answers and photographs are compared at two pixels a cell, from the paper's descriptor with cells of 8.
"""

from __future__ import annotations

import argparse
import random
import time
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from errors import correlation
from nablahog import LearnedPrior, hog, presets, train_prior
from nablahog.invert.prior_network import Architecture
from nablahog.invert.training_windows import BATCH
from nablahog.paper.photographs import read_folder
from photographs import photographs

SPEC = presets.paper(8)
COUNTS = (808, 2000)
WIDTHS = {"1 M": (24, 48, 96), "4 M": (56, 112, 224), "5 M": (64, 128, 256), "8 M": (80, 160, 320)}
DEFAULT = "5 M"
BLOCKS = (1, 2, 1)
COARSE = 4  # pixels that one of the comparison covers, along each axis


def likeness(prior: LearnedPrior, images: Tensor) -> tuple[float, float, float]:
    """CC, |CC| and the share of images that are no negatives."""
    answers = prior.expected(hog(images, SPEC), SPEC, (images.shape[2], images.shape[3]))
    each = correlation(avg_pool2d(answers, COARSE)[:, 0], avg_pool2d(images, COARSE)[:, 0])
    return float(each.mean()), float(each.abs().mean()), float((each > 0).float().mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, required=True, help="folder to learn from, and folders below")
    parser.add_argument("--test", type=Path, required=True, help="folder of 128x128 images to judge by")
    parser.add_argument("--steps", type=int, default=1000, help=f"of {BATCH} windows each")
    parser.add_argument("--counts", type=int, nargs="*", default=COUNTS, help="photographs, beside all of them")
    parser.add_argument("--weights", choices=WIDTHS, nargs="*", default=[*WIDTHS], help="sizes, of all photographs")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--precision", choices=("float32", "bfloat16"), default="float32")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    every, test = read_folder(options.images, size=0, recursive=True).images, photographs(options.test)
    names = random.Random(0).sample(sorted(every), len(every))
    runs = [
        *((count, DEFAULT) for count in (*options.counts, len(names))),
        *((len(names), size) for size in options.weights),
    ]
    print("| photographs | weights | epochs | CC | abs CC | no negatives | minutes |")
    print("|---:" * 7 + "|")
    for count, size in dict.fromkeys(runs):
        images = {name: every[name] for name in names[:count]}
        epochs = max(1, round(options.steps * BATCH / count))
        began = time.monotonic()
        architecture = Architecture(WIDTHS[size], BLOCKS)
        prior = train_prior(images, SPEC, epochs=epochs, architecture=architecture, precision=options.precision)
        minutes = (time.monotonic() - began) / 60
        cc, abs_cc, share = likeness(prior, test)
        figures = f"{cc:.3f} | {abs_cc:.3f} | {share:.0%} | {minutes:.0f}"
        print(f"| {count:,} | {len(prior.weights):,} | {epochs} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
