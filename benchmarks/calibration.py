"""Is the learned prior as sure of the polarity as it is right, and do samples disagree where it is wrong?

    python benchmarks/calibration.py --images DIR [DIR ...] [--prior FILE] [--every N] [--threads N] [--chart FILE]

Each photograph is inverted from the descriptors of three unsigned presets, and by multi-scale-more.  A pre-image is
right if its correlation with the photograph is positive.  The table has, for pre-images of which the prior is so sure,
how many there are, how sure it is in the mean, and how many are right, with the 95 % interval of Wilson.  Above it are
the means of each way, and Brier's score: the mean square of confidence minus right; 0.25 is that of a coin.

Below it is, of the paper's descriptor, how the agreement of four samples goes with the magnitude of the pre-image's
correlation with the photograph: Spearman's correlation of the two, and the latter's mean for each third of the images,
by agreement.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import torch
from scipy.stats import spearmanr
from torch import Tensor

from errors import correlation
from nablahog import LearnedPrior, hog, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import Reconstruction, reconstruct_samples, scale_descriptors
from nablahog.invert.prior_choice import PriorChoice
from nablahog.viz.svg import Drawing
from photographs import photographs

EDGES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
BATCH = 16
SIDE, MARGIN = 360, 48  # pixels of the chart


def agreement(images: Tensor, prior: PriorChoice) -> tuple[Tensor, Tensor]:
    """How far samples agree (B,), and the magnitude of the pre-image's correlation with the photograph (B,)."""
    spec, size = presets.paper(8), (images.shape[2], images.shape[3])
    descriptor = hog(images, spec)
    samples = reconstruct_samples(descriptor, spec, size, prior=prior, quality="fast")
    made = reconstruct(descriptor, spec, size, prior=prior, quality="fast").image
    return samples.agreement, correlation(made[:, 0], images[:, 0]).abs()


def judged(images: Tensor, prior: PriorChoice) -> Iterator[tuple[str, Tensor, Tensor]]:
    """How images are inverted, how sure the prior is (B,), and whether it is right (B,)."""
    for spec in (presets.paper(8), presets.skimage(), presets.opencv()):
        result = reconstruct(hog(images, spec), spec, images.shape[2:], prior=prior, quality="fast")
        yield spec.name, confidence(result), right(result.image, images)
    spec = presets.paper(8)
    levels = reconstruct_multiscale(scale_descriptors(images, spec), spec, images.shape[2:], prior=prior)
    last = levels[-1].reconstruction
    yield "multi-scale-more", confidence(last), right(last.image, images)


def confidence(result: Reconstruction) -> Tensor:
    """How sure the prior is of each polarity, (B,)."""
    assert result.polarity_confidence is not None, "the prior says how sure it is of every unsigned descriptor"
    return result.polarity_confidence


def right(made: Tensor, images: Tensor) -> Tensor:
    """Whether each is rather the photograph than its negative, (B,)."""
    return correlation(made[:, 0], images[:, 0]) > 0


def wilson(count: int, n: int) -> tuple[float, float]:
    """The 95 % interval of a share, ``count`` of ``n``."""
    z = 1.96
    centre = (count + z * z / 2) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(count * (n - count) / n + z * z / 4)
    return centre - half, centre + half


def table(sure: Tensor, is_right: Tensor) -> list[tuple[float, float, float, float, int]]:
    """Of each interval of confidence: its mean, the share that is right, that share's interval, and their number."""
    rows = []
    for low, high in pairwise(EDGES):
        members = (sure >= low) & ((sure < high) | (high == EDGES[-1]))
        n, count = int(members.sum()), int(is_right[members].sum())
        if n:
            rows.append((float(sure[members].mean()), count / n, *wilson(count, n), n))
    return rows


def draw(path: Path, rows: Sequence[tuple[float, float, float, float, int]]) -> None:
    """The share that is right over the confidence, beside the diagonal on which both are the same."""
    drawing = Drawing(SIDE + 2 * MARGIN, SIDE + 2 * MARGIN, "Calibration of the polarity", "Right over sure.")

    def place(sure: float, share: float) -> tuple[float, float]:
        return MARGIN + (sure - 0.5) * 2 * SIDE, MARGIN + (1 - share) * SIDE

    for k in range(6):
        sure, share = 0.5 + k / 10, k / 5
        drawing.line([place(sure, 0), place(sure, 1)], "grid")
        drawing.line([place(0.5, share), place(1, share)], "grid")
        drawing.note((place(sure, 0)[0], place(sure, 0)[1] + 17), f"{sure:g}", anchor="middle")
        drawing.note((MARGIN - 6, place(0.5, share)[1] + 4), f"{share:g}", anchor="end")
    drawing.line([place(0.5, 0.5), place(1, 1)], "faint", 2, dashed=True)
    for sure, share, low, high, _ in rows:
        drawing.line([place(sure, low), place(sure, high)], "series0", 2)
        drawing.dot(place(sure, share), "series0", 4)
    drawing.note((MARGIN, MARGIN - 12), "share that is right, with its 95 % interval")
    drawing.note((MARGIN + SIDE / 2, SIDE + 2 * MARGIN - 8), "confidence in the polarity", anchor="middle")
    path.write_text(drawing.svg(), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, nargs="+", required=True, help="folders of images, each of one size")
    parser.add_argument("--prior", type=Path, help="by default those that come with nablahog")
    parser.add_argument("--every", type=int, default=1, help="only each so many-th image")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--chart", type=Path, help="an SVG")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    prior: PriorChoice = "default" if options.prior is None else LearnedPrior.load(options.prior)
    found: dict[str, list[tuple[Tensor, Tensor]]] = {}
    agreements = []
    for folder in options.images:
        for images in photographs(folder)[:: options.every].split(BATCH):
            for name, sure, is_right in judged(images, prior):
                found.setdefault(name, []).append((sure, is_right))
            agreements.append(agreement(images, prior))
    columns = {name: tuple(torch.cat(part) for part in zip(*parts, strict=True)) for name, parts in found.items()}
    columns["all"] = tuple(torch.cat(part) for part in zip(*columns.values(), strict=True))
    print("| inverted from | n | sure | right | Brier |\n|---|---:|---:|---:|---:|")
    for name, (sure, is_right) in columns.items():
        brier = float((sure - is_right.to(sure)).square().mean())
        print(f"| {name} | {len(sure)} | {sure.mean():.3f} | {is_right.float().mean():.3f} | {brier:.3f} |")
    print("\n| sure | n | in the mean | right |\n|---|---:|---:|---:|")
    rows = table(*columns["all"])
    for mean, share, low, high, n in rows:
        print(f"| {math.floor(mean * 10) / 10:.1f} … | {n} | {mean:.3f} | {share:.3f} ({low:.3f}–{high:.3f}) |")
    agree, alike = (torch.cat(part) for part in zip(*agreements, strict=True))
    thirds = ", ".join(f"{part.mean():.3f}" for part in alike[agree.argsort()].chunk(3))
    print(f"\nAgreement of samples with abs CC: Spearman {spearmanr(agree, alike).statistic:.2f}; by thirds: {thirds}")
    if options.chart:
        draw(options.chart, rows)


if __name__ == "__main__":
    main()
