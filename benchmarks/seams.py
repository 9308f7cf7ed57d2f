"""What detectors look for: how much do the borders of cells show, and what is to be seen?

    python benchmarks/seams.py MODEL... [--sheet FILE.png]

Models are files of voc-release5, or arrays of OpenCV's detectors (a vector, named …_WIDTHxHEIGHT.npy).  **Seams**: the
mean |difference| of neighbouring pixels across borders of cells, divided by the mean inside cells; 1 where borders do
not show.  **Flat**: the share of pixels in flat regions: those that equal their four neighbours, and what touches them.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import max_pool2d, pad

from nablahog import presets
from nablahog.hog import HOGSpec
from nablahog.hog.layout import from_layout
from nablahog.invert import reconstruct_template
from nablahog.io.dpm_file import is_dpm_file, load_dpm
from nablahog.viz.pictures import Panel, contact_sheet, glyphs
from timing import table


def seams(image: Tensor, cell: int) -> float:
    """How many times larger the differences of an image (H, W) are across borders of cells than inside."""
    across, inside = [], []
    for plane in (image, image.T):
        steps = plane.diff(dim=0).abs()
        border = torch.arange(1, len(plane)) % cell == 0
        across.append(steps[border].flatten())
        inside.append(steps[~border].flatten())
    return float(torch.cat(across).mean() / torch.cat(inside).mean())


def flat(image: Tensor) -> float:
    """The share of an image (H, W) in flat regions."""
    padded = pad(image[None], (1, 1, 1, 1), mode="replicate")[0]
    neighbours = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
    centres = torch.stack([image == each for each in neighbours]).all(dim=0)
    return float(max_pool2d(centres[None].float(), 3, 1, 1).double().mean())


def templates(path: Path) -> Iterator[tuple[str, Tensor, HOGSpec]]:
    """Names, weights (1, rows, cols, channels) and dialects of a file's templates."""
    if is_dpm_file(path):
        model = load_dpm(path)
        for each in model.filters:
            yield f"{model.class_name}, {each.name}", each.weights[None], presets.dpm(model.cell_size)
        return
    match = re.search(r"(\d+)x(\d+)$", path.stem)
    if match is None:
        raise ValueError(f"{path}: expected a name that ends in WIDTHxHEIGHT.npy")
    width, height = (int(side) for side in match.groups())
    spec = presets.opencv((width, height))
    rows, cols = spec.grid(height, width)
    vector = torch.from_numpy(np.load(path).astype(np.float32).ravel()[: rows * cols * spec.channels])  # no bias
    yield path.stem, from_layout(vector[None], spec, (height, width)), spec


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--sheet", type=Path, help="where to draw them: glyphs of the weights, and the image")
    options = parser.parse_args()
    rows, panels = [], []
    for path in options.models:
        for name, weights, spec in templates(path):
            result = reconstruct_template(weights, spec)
            image = result.image[0, 0]
            rows.append([name, f"{seams(image, spec.cell_size[0]):.2f}", f"{100 * flat(image):.1f} %"])
            panels.append([Panel(glyphs(weights[0].clamp(min=0), spec), name), Panel(image, "what it sees")])
    print(table(["template", "seams", "flat"], rows))
    if options.sheet is not None:
        contact_sheet(panels, height=256).convert("L").save(options.sheet)


if __name__ == "__main__":
    main()
