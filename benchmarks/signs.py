"""How much of the signs that an unsigned descriptor does not hold is won back: of regions, and of the whole image.

    python benchmarks/signs.py [--images DIR] [--threads N]

The first table is of the coarse images, one gray value a cell, that region signs make of the paper's descriptor with
cells of 8: their correlation with the photograph's own, whichever of it and its negative is right.  Of the 32 sign
patterns found it has the one of least energy, the mean of all, which is what `nablahog.reconstruct` expects, and the
one that somebody would choose who knows the photograph; with the flat border as one background, and without.

The second is of polarity: how often the cues prefer a photograph, as it is, to its negative.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from errors import correlation
from nablahog import presets
from nablahog.hog.descriptor import histograms
from nablahog.invert import signs
from nablahog.invert.polarity import brightness_cues, looks_negative
from photographs import photographs

CELL = 8


def likeness(cells: Tensor, own: Tensor) -> Tensor:
    """|correlation| (B, K) of images (B, K, rows, cols) with the photographs' own (B, 1, rows, cols)."""
    each = [correlation(cells[:, k], own[:, 0]) for k in range(cells.shape[1])]
    return torch.stack(each, dim=1).abs()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of 128x128 images; by default those scikit-image installs")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    images = photographs(options.images)
    spec, own = presets.paper(CELL), avg_pool2d(images, CELL)
    votes = histograms(images, spec)

    print(f"{len(images)} images of {images.shape[2]}x{images.shape[3]}\n")
    print("| coarse image, abs CC | least energy | mean | best |\n|---|---:|---:|---:|")
    for name, background in (("without a background", 0.0), ("with", signs.BACKGROUND)):
        signs.BACKGROUND = background
        result = signs.signed_cells(votes, spec, seed=0).images
        each = likeness(result, own)
        mean = likeness(result.mean(dim=1, keepdim=True), own)
        print(f"| {name} | {each[:, 0].mean():.3f} | {mean.mean():.3f} | {each.amax(dim=1).mean():.3f} |")

    print("\n| cue | prefers the photograph | says nothing |\n|---|---:|---:|")
    cues = brightness_cues(images)
    names = ("exactly flat is bright", "flat is bright", "strong texture is bright", "highlights")
    for name, cue in zip(names, cues.unbind(dim=1), strict=True):
        print(f"| {name} | {(cue > 0).float().mean():.2f} | {(cue == 0).float().mean():.2f} |")
    print(f"| all, weighted | {(~looks_negative(images)).float().mean():.2f} | |")


if __name__ == "__main__":
    main()
