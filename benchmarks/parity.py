"""How far the operator is from each library's own HOG, on every stored output of theirs, as a Markdown table.

In the layout and the precision of the library, bytes as input; see ``tests/golden/README.md`` for what is stored.

A second table has MaskFeat's layer on the numbers of a training, and how far that is from itself on bytes.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import torch
from skimage import data
from torch.nn.functional import conv2d, normalize, pad

from nablahog.hog import hog

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.golden import PEERS, Case, archive, cases


def difference(case: Case) -> torch.Tensor:
    """The operator's entries less the library's, in one row, float64."""
    torch.set_default_dtype(case.dtype)
    result = hog(case.image, case.spec, layout="native")[0]
    torch.set_default_dtype(torch.float32)
    return (result.double() - case.stored.double()).flatten()


def maskfeat_layer(images: torch.Tensor, bins: int = 9, cell: int = 8, window: int = 16) -> torch.Tensor:
    """MaskFeat's ``HOGLayerC`` from its formulas: images (B, 3, H, W) to (B, 3, bins, rows, cols)."""
    sobel = torch.tensor([[1.0, 0.0, -1.0], [2.0, 0.0, -2.0], [1.0, 0.0, -1.0]])
    padded = pad(images, (1, 1, 1, 1), mode="reflect")
    gx, gy = (conv2d(padded, mask.expand(3, 1, 3, 3), groups=3) for mask in (sobel, sobel.T))
    offsets = torch.arange(window) - (window - 1) / 2
    gaussian = torch.exp(-0.5 * (offsets / (window // 2)) ** 2)
    weights = (gaussian[:, None] * gaussian).repeat(images.shape[2] // window, images.shape[3] // window)
    bin_of_pixel = (torch.atan2(gx, gy) / math.pi * bins).floor().long() % bins
    votes = torch.zeros(*images.shape[:2], bins, *images.shape[2:])
    votes.scatter_add_(2, bin_of_pixel[:, :, None], (torch.stack([gx, gy]).norm(dim=0) * weights)[:, :, None])
    return normalize(votes.unfold(3, cell, cell).unfold(4, cell, cell).sum((-1, -2)), dim=2)


def compare_inputs() -> None:
    """Prints the share of entries that differ by more than 1e-4, and the distance relative to ‖φ‖."""
    names = ("astronaut", "chelsea", "coffee")
    pixels = torch.stack([torch.from_numpy(getattr(data, name)()[:224, 64:288].copy()) for name in names])
    images = pixels.permute(0, 3, 1, 2)
    mean, deviation = torch.tensor([[[[0.485]], [[0.456]], [[0.406]]], [[[0.229]], [[0.224]], [[0.225]]]])
    inputs = {
        "0…255": images.float(),
        "0…1, those over 255": images / 255,
        "mean subtracted, over the standard deviation": (images / 255 - mean) / deviation,
    }
    layer_on_bytes = maskfeat_layer(inputs["0…255"])
    restored = inputs["mean subtracted, over the standard deviation"] * deviation + mean
    ours = hog((255 * restored).round().to(torch.uint8), "maskfeat", layout="native")
    print("| input of the layer | preset on bytes | the layer on 0…255 |")
    print("|---|---|---|")
    for name, values in inputs.items():
        layer = maskfeat_layer(values)
        cells = []
        for other in (ours, layer_on_bytes):
            share, distance = ((layer - other).abs() > 1e-4).float().mean(), (layer - other).norm() / layer.norm()
            cells.append(f"{100 * float(share):.0f} %, {float(distance):.2g}")
        print(f"| {name} | {' | '.join(cells)} |")


def main() -> None:
    """Print the tables."""
    print("| library | version | outputs | entries | largest difference | root mean square |")
    print("|---|---|---|---|---|---|")
    for peer in PEERS:
        differences = [difference(case) for case in cases(peer)]
        every = torch.cat(differences)
        largest, rms = float(every.abs().max()), float(every.square().mean().sqrt())
        version = str(archive(peer)["version"]).split(",")[0]
        print(f"| {peer} | {version} | {len(differences)} | {len(every):,} | {largest:.1e} | {rms:.1e} |")
    print()
    compare_inputs()


if __name__ == "__main__":
    main()
