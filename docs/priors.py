"""Makes docs/priors.png: photographs from unsigned descriptors, without the priors of the package and with them.

`python docs/priors.py`; two minutes.  The photographs, of 128x128, come with scikit-image, and are in the public domain
or under CC0.  Above each pre-image is its correlation with the photograph, and for those with the prior how sure that
is of the polarity.
"""

from __future__ import annotations

from pathlib import Path

import torch
from pictures import NAMES, photograph
from torch import Tensor

from nablahog import Reconstruction, hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import scale_descriptors
from nablahog.invert.prior_choice import PriorChoice
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


def main() -> None:
    images = torch.cat([photograph(name, 128) for name in NAMES])
    results = columns(images)
    heads = sorted(
        results, key=lambda head: [*SPECS, "more"].index(head.split(" ")[0])
    )  # with the prior beside without
    rows = []
    for index, name in enumerate(NAMES):
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
