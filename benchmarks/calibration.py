"""Is the confidence of the learned prior in the polarity the share that is right?

    python benchmarks/calibration.py [--images DIR …] [--every N]

Each photograph is inverted from the descriptors of three unsigned presets, and by multi-scale-more; a pre-image is
right if its correlation with the photograph is positive.  Below is how the agreement of four samples goes with the
magnitude of that correlation.

The table has the share that is right by confidence, with the 95 % interval of Wilson.  Brier's score is the mean square
of confidence minus right; 0.25 is that of a coin.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import spearmanr
from torch import Tensor

from nablahog import hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import reconstruct_samples, scale_descriptors
from preimages import photographs
from timing import table

BATCH = 16
Floats = NDArray[np.float64]


def wilson(count: float, n: int) -> tuple[float, float]:
    """The 95 % interval of a share, ``count`` of ``n``."""
    z = 1.96
    centre = (count + z * z / 2) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(count * (n - count) / n + z * z / 4)
    return centre - half, centre + half


def calibrated(sure: Floats, right: Floats, edges: Sequence[float]) -> str:
    """The table by confidence, and Brier's score."""
    rows = []
    for low, high in pairwise(edges):
        members = (sure >= low) & ((sure < high) | (high == edges[-1]))
        n = int(members.sum())
        if n:
            a, b = wilson(right[members].sum(), n)
            share = f"{right[members].mean():.3f} ({a:.3f}–{b:.3f})"
            rows.append([f"{low:g}…{high:g}", str(n), f"{sure[members].mean():.3f}", share])
    brier, constant = np.mean((sure - right) ** 2), right.mean() * (1 - right.mean())
    told = f"Brier's score {brier:.3f}; of the share that is right {constant:.3f}"
    return f"{table(['confidence', 'n', 'mean', 'right'], rows)}\n\n{told}"


def correlations(made: Tensor, images: Tensor) -> Floats:
    return np.array([metrics.cross_correlation(*pair) for pair in zip(made[:, 0], images[:, 0], strict=True)])


def polarity(options: argparse.Namespace) -> None:
    specs = {"paper": presets.paper(), "skimage": presets.skimage(), "opencv": presets.opencv()}
    pairs: dict[str, list[tuple[Floats, Floats]]] = {}
    agreements, magnitudes = [], []
    for folder in options.images or [None]:
        for images in photographs(folder)[:: options.every].split(BATCH):
            size = images.shape[2], images.shape[3]
            results = {name: reconstruct(hog(images, spec), spec, size, quality="fast") for name, spec in specs.items()}
            paper = specs["paper"]
            several: list[Tensor] = scale_descriptors(images, paper)
            scales = reconstruct_multiscale(several, paper, size)
            results["multi-scale-more"] = scales[-1].reconstruction
            for name, result in results.items():
                assert result.polarity_confidence is not None
                right = (correlations(result.image, images) > 0).astype(np.float64)
                pairs.setdefault(name, []).append((result.polarity_confidence.double().numpy(), right))
            samples = reconstruct_samples(hog(images, paper), paper, size, quality="fast")
            agreements.append(samples.agreement)
            magnitudes.append(abs(correlations(results["paper"].image, images)))
    columns = {name: tuple(map(np.concatenate, zip(*parts, strict=True))) for name, parts in pairs.items()}
    rows = [[name, f"{sure.mean():.3f}", f"{right.mean():.3f}"] for name, (sure, right) in columns.items()]
    print(table(["inverted from", "sure", "right"], rows), end="\n\n")
    sure, right = (np.concatenate(part) for part in zip(*columns.values(), strict=True))
    print(calibrated(sure, right, (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)))
    rank = spearmanr(torch.cat(agreements), np.concatenate(magnitudes)).statistic
    print(f"Agreement of samples with the magnitude of the correlation: Spearman {rank:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, nargs="*", help="folders of images, each of one size")
    parser.add_argument("--every", type=int, default=1, help="take every N-th image only")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    polarity(options)


if __name__ == "__main__":
    main()
