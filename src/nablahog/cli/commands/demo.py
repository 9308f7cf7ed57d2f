"""``nablahog demo``: a photograph, inverted from both descriptors of the paper, and a page that shows it."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from ...io.files import output_folder, write_text
from ...io.images import limit_size, sample_photograph, write_image
from ...requests.dialect import PRESETS
from ...requests.inversion import InvertRequest
from ...requests.sources import from_photo
from ..results import inversion_page
from ..results.inversion import Inversion, invert_batch, say_unsure
from ..terminal import counter, print_table, say_page

DEMO_SIZE = 256
DESCRIPTORS = ("uoctti", "paper")  # both of the paper; the one that keeps more comes first
TITLE = "A photograph from its HOG descriptor"
LEAD = (
    "Each image was found from a HOG descriptor alone. The photograph is not an input of the inversion; it is shown "
    "for comparison. HOG contains neither colour nor brightness, so the pre-image is gray and is compared with the "
    "gray photograph. In the difference, middle gray means equal. The uoctti descriptor tells bright from dark. The "
    "paper's has unsigned gradients, which are the same for a region and its negative, so a learned prior has to guess "
    "which regions are bright. Beside its image are the same image, gray where the prior is unsure; its negative, if "
    "that may be right, and how probably; and three samples, further images that the prior thinks possible. What the "
    "descriptor leaves open, such as fine details, the prior makes up."
)
SAMPLES = 3  # of the descriptor that leaves the signs of regions open
REMARK = "The photograph, Eileen Collins by NASA, is in the public domain and comes with scikit-image."


def demo(arguments: Namespace) -> None:
    """Inverts a photograph from both descriptors; writes pictures, ``figures.json`` and ``index.html``."""
    photo = limit_size(sample_photograph("astronaut"), DEMO_SIZE)
    with output_folder(arguments.output) as folder, counter("nablahog demo", "evaluations") as progress:
        inversions = []
        for name in DESCRIPTORS:
            source = from_photo("astronaut", name, photo, PRESETS[name](), size=0)
            progress_of = partial(progress, what=name)
            request = InvertRequest(samples=None if source.spec.signed else SAMPLES)
            inversions += invert_batch([source], request, device=torch.device("cpu"), progress=progress_of)
        _write(folder, photo, inversions)
    print_table([inversion.terminal_row() for inversion in inversions])
    say_unsure(inversions)
    say_page(folder / "index.html")


def _write(folder: Path, photo: Tensor, inversions: Sequence[Inversion]) -> None:
    write_image(folder / "photograph.png", photo)
    for inversion in inversions:
        inversion.write(folder)
        compared = inversion.panels()[-1]
        write_image(folder / f"{inversion.source.stem}_difference.png", compared.picture)
    figures = [inversion.figures() for inversion in inversions]
    write_text(folder / "figures.json", json.dumps(figures, indent=2))
    write_text(
        folder / "index.html",
        inversion_page.page(inversions, title=TITLE, lead=LEAD, figures="figures.json", remark=REMARK),
    )
