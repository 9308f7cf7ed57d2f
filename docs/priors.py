"""Makes docs/priors.png: photographs from unsigned descriptors, without the priors of the package and with them.

`python docs/priors.py`; two minutes.  The photographs, of 128x128, come with scikit-image, and are in the public domain
or under CC0; the letters are drawn.  Above each pre-image is its correlation with the photograph, and for those with
the prior how sure that is of the polarity.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from pictures import NAMES, photograph
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from nablahog import Reconstruction, hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import scale_descriptors
from nablahog.invert.prior.choice import PriorChoice
from nablahog.viz.pictures import Panel, contact_sheet

SPECS = {"paper": presets.paper(8), "skimage": presets.skimage(), "opencv": presets.opencv(), "aubry": presets.aubry(8)}
PRIORS: tuple[PriorChoice, ...] = (None, "default")


def columns(images: Tensor) -> dict[str, Reconstruction]:
    """All pre-images, by the heads of their columns."""
    size, results = (images.shape[2], images.shape[3]), {}
    for prior in PRIORS:
        with_it = " + prior" if prior else ""
        for name, spec in SPECS.items():
            results[f"{name}{with_it}"] = reconstruct(hog(images, spec), spec, size, prior=prior)
        spec = SPECS["paper"]
        levels = reconstruct_multiscale(scale_descriptors(images, spec), spec, size, prior=prior)
        results[f"more{with_it}"] = levels[-1].reconstruction
    return results


def letters() -> Tensor:
    """Two words, black on white, (1, 1, 128, 128)."""
    page = Image.new("L", (128, 128), 255)
    draw = ImageDraw.Draw(page)
    for row, word in enumerate(("See the", "letters")):
        draw.text((8, 20 + 46 * row), word, fill=0, font=ImageFont.load_default(32))
    return torch.from_numpy(np.asarray(page, dtype=np.float32) / 255)[None, None]


def main() -> None:
    images = torch.cat([*(photograph(name, 128) for name in NAMES), letters()])
    results = columns(images)
    heads = sorted(
        results, key=lambda head: [*SPECS, "more"].index(head.split(" ")[0])
    )  # with the prior beside without
    rows = []
    for index, name in enumerate((*NAMES, "letters")):
        row = [Panel(images[index, 0], name)]
        for head in heads:
            result = results[head]
            made, sure = result.image[index, 0], result.polarity_confidence
            how = "" if sure is None else f", {sure[index]:.0%}"
            row.append(Panel(made, f"{metrics.cross_correlation(made, images[index, 0]):.2f}{how} {head}"))
        rows.append(row)
    contact_sheet(rows, height=128).convert("L").quantize(64).save(
        Path(__file__).with_name("priors.png"), optimize=True
    )


if __name__ == "__main__":
    torch.set_num_threads(2)
    main()
