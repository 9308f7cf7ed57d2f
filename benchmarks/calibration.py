"""Is the confidence of the learned prior in the bright side of images and regions the share that is right?

    python benchmarks/calibration.py polarity [--images DIR …] [--presets paper skimage opencv] [--every N]
    python benchmarks/calibration.py fit --images DIR … [--most 40] -o unsigned.npz

Each photograph is inverted from the descriptors of unsigned presets.  A pre-image is right if its correlation with the
photograph is positive; a region of it, which a Gaussian of 8 pixels sees around every eighth pixel along each axis, if
it is brighter than the mean of its image where the photograph is.  ``--more`` adds multi-scale-more, and how the
agreement of four samples goes with the magnitude of the correlation.  ``fit`` writes the package's prior for unsigned
descriptors, with the confidence fitted to photographs of these folders, none of which it may have been trained on.

The tables have the share that is right by confidence; of images with the 95 % interval of Wilson.  Brier's score is the
mean square of confidence minus right; beside it is that of the best constant, the share that is right.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import binomtest, spearmanr
from torch import Tensor

from nablahog import Reconstruction, hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.hog.gradient import gray
from nablahog.invert import default_prior, reconstruct_samples, scale_descriptors
from nablahog.invert.prior.calibration import calibrate
from nablahog.invert.prior.confidence import REGION_PIXELS
from nablahog.invert.unknowns import low_pass
from nablahog.io.images import read_image
from preimages import SUFFIXES, photographs
from timing import table

BATCH = 16
EDGES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.0)
SURE_REGION = 0.8
Floats = NDArray[np.float64]


def tabulate(confidence: Floats, right: Floats, edges: Sequence[float], *, intervals: bool = True) -> str:
    """The table by confidence."""
    rows = []
    for low, high in pairwise(edges):
        members = (confidence >= low) & ((confidence < high) | (high == edges[-1]))
        n = int(members.sum())
        if n:
            share = f"{right[members].mean():.3f}"
            if intervals:
                interval = binomtest(int(right[members].sum()), n).proportion_ci(method="wilson")
                share += f" ({interval.low:.3f}–{interval.high:.3f})"
            rows.append([f"{low:g}…{high:g}", str(n), f"{confidence[members].mean():.3f}", share])
    return table(["confidence", "n", "mean", "right"], rows)


def brier(confidence: Floats, right: Floats) -> tuple[float, float]:
    """Brier's score, and that of the best constant."""
    return float(np.mean((confidence - right) ** 2)), float(right.mean() * (1 - right.mean()))


def calibrated(confidence: Floats, right: Floats, edges: Sequence[float]) -> str:
    """The table by confidence, and Brier's score."""
    score, constant = brier(confidence, right)
    said = f"Brier's score {score:.3f}; of the share that is right {constant:.3f}"
    return f"{tabulate(confidence, right, edges)}\n\n{said}"


def correlations(preimages: Tensor, images: Tensor) -> Floats:
    return np.array([metrics.cross_correlation(*pair) for pair in zip(preimages[:, 0], images[:, 0], strict=True)])


class Signs(NamedTuple):
    """Confidences and whether they are right, of images (n,) and of their regions (m,)."""

    polarity: Floats
    right: Floats
    regions: Floats
    regions_right: Floats


def judge(result: Reconstruction, images: Tensor) -> Signs:
    """The confidences of pre-images, beside the photographs."""
    assert result.polarity_confidence is not None
    assert result.region_confidence is not None
    right = (correlations(result.image, images) > 0).astype(np.float64)
    places = slice(int(REGION_PIXELS) // 2, None, int(REGION_PIXELS))

    def bright(pictures: Tensor) -> Tensor:
        means = pictures.mean(dim=(2, 3), keepdim=True)
        return (low_pass(pictures.double() - means, REGION_PIXELS) > 0)[..., places, places]

    regions_right = (bright(result.image) == bright(images)).double()
    regions = result.region_confidence.double()[..., places, places]
    return Signs(
        result.polarity_confidence.double().numpy(), right, regions.flatten().numpy(), regions_right.flatten().numpy()
    )


def join(parts: Iterable[Signs]) -> Signs:
    return Signs(*map(np.concatenate, zip(*parts, strict=True)))


def polarity(options: argparse.Namespace) -> None:
    specs = {name: getattr(presets, name)() for name in options.presets}
    found: dict[tuple[str, str], Signs] = {}
    agreements, magnitudes = [], []
    for folder in options.images or [None]:
        parts: dict[str, list[Signs]] = {}
        for images in photographs(folder)[:: options.every].split(BATCH):
            size = images.shape[2], images.shape[3]
            for name, spec in specs.items():
                result = reconstruct(hog(images, spec), spec, size, quality="fast")
                parts.setdefault(name, []).append(judge(result, images))
            if options.more:
                paper = presets.paper()
                several: list[Tensor] = scale_descriptors(images, paper)
                levels = reconstruct_multiscale(several, paper, size)
                parts.setdefault("multi-scale-more", []).append(judge(levels[-1].reconstruction, images))
                samples = reconstruct_samples(hog(images, paper), paper, size, quality="fast")
                agreements.append(samples.agreement)
                magnitudes.append(abs(correlations(samples.image[:, 0], images)))
        found |= {(folder.name if folder else "scikit-image", name): join(each) for name, each in parts.items()}
    rows = []
    for (kind, name), signs in found.items():
        sure = signs.regions >= SURE_REGION
        share = f"{signs.regions_right[sure].mean():.3f} of {sure.mean():.0%}" if sure.any() else "–"
        figures = [signs.polarity.mean(), signs.right.mean(), *brier(signs.polarity, signs.right)]
        figures += [signs.regions_right.mean(), *brier(signs.regions, signs.regions_right)]
        rows.append([kind, name, str(len(signs.right)), *(f"{figure:.3f}" for figure in figures), share])
    heads = ["photographs", "inverted from", "n", "confidence", "right", "Brier", "constant"]
    heads += ["regions right", "Brier", "constant", f"regions ≥ {SURE_REGION}: right"]
    print(table(heads, rows))
    signs = join(found.values())
    print(f"\nImages\n\n{tabulate(signs.polarity, signs.right, EDGES)}")
    print(f"\nRegions\n\n{tabulate(signs.regions, signs.regions_right, (0, *EDGES), intervals=False)}")
    if options.more:
        rank = spearmanr(torch.cat(agreements), np.concatenate(magnitudes)).statistic
        print(f"\nAgreement of samples with the magnitude of the correlation: Spearman {rank:.2f}")


def fit(options: argparse.Namespace) -> None:
    images = {}
    for folder in options.images:
        files = sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)
        for file in files[:: max(1, len(files) // options.most)][: options.most]:
            images[f"{folder.name}/{file.name}"] = gray(read_image(file)[None])[0, 0]
    prior = calibrate(default_prior("paper"), images)
    prior.save(options.output)
    print(f"{len(images)} photographs: {prior.calibration}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    of_polarity = commands.add_parser("polarity")
    of_polarity.add_argument("--images", type=Path, nargs="*", help="folders of images, each of one size")
    of_polarity.add_argument("--presets", nargs="+", default=["paper", "skimage", "opencv"])
    of_polarity.add_argument("--every", type=int, default=1, help="take every N-th image only")
    of_polarity.add_argument("--more", action="store_true", help="also multi-scale-more, and samples")
    of_polarity.add_argument("--threads", type=int, default=1)
    of_polarity.set_defaults(run=polarity)
    of_fit = commands.add_parser("fit")
    of_fit.add_argument("--images", type=Path, nargs="+", required=True, help="folders, each a kind of photographs")
    of_fit.add_argument("--most", type=int, default=40, help="photographs of each folder")
    of_fit.add_argument("-o", "--output", type=Path, required=True)
    of_fit.add_argument("--threads", type=int, default=1)
    of_fit.set_defaults(run=fit)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    options.run(options)


if __name__ == "__main__":
    main()
