"""The demonstration: one photograph, both descriptors of the paper, their pre-images, and a page that shows them."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path

import torch

from ...io.files import replacing
from ...io.images import limit_size, write_image
from ...metrics import DEFINITIONS
from ...viz import html
from ..arguments.preset_parameters import PRESETS
from ..inputs.sources import from_photo
from ..results.inversion import Inversion, invert_batch

SIZE = 256
DESCRIPTORS = ("paper", "uoctti")  # both of the paper
LEAD = (
    "Each row starts from a HOG descriptor alone: an image was sought whose descriptor is the same. The photograph is "
    "shown for comparison only; the inversion never saw it. HOG keeps neither colour nor brightness, so the pre-image "
    "is gray and compared with the gray photograph; in the difference, middle gray means equal. The paper's "
    "descriptor, of unsigned gradients, does not even tell a region from its negative, so parts of that pre-image may "
    "come out inverted."
)


def run_demo(
    folder: Path,
    *,
    device: torch.device,
    seed: int,
    progress: Callable[[str, int, int], None] | None = None,
    max_evaluations: int | None = None,
) -> list[Inversion]:
    """Writes pictures, ``figures.json`` and ``index.html`` into ``folder``, which exists.

    Args:
        folder: where to write.
        device: where to compute.
        seed: of the starting images.
        progress: called with the descriptor's name, the evaluations done and their largest number.
        max_evaluations: of the objective, for each descriptor; None for the default.

    Returns:
        One inversion for each descriptor.

    Raises:
        OSError: a file cannot be written.
    """
    from skimage import data  # slow to import; its astronaut ships inside the package, nothing is downloaded

    astronaut = torch.from_numpy(data.astronaut())  # type: ignore[no-untyped-call]
    photo = limit_size(astronaut.permute(2, 0, 1) / 255, SIZE)
    inversions = []
    for name in DESCRIPTORS:
        source = from_photo("astronaut", name, photo, PRESETS[name](), size=0, device=device)
        called = None if progress is None else partial(progress, name)
        inversions += invert_batch([source], device=device, seed=seed, max_evaluations=max_evaluations, progress=called)
    write_image(folder / "photograph.png", photo)
    for inversion in inversions:
        inversion.write(folder)
        _, _, _, compared = inversion.panels()
        write_image(folder / f"{inversion.source.stem}_difference.png", compared.picture)
    figures = [inversion.figures() for inversion in inversions]
    with replacing(folder / "figures.json") as file:
        file.write(json.dumps(figures, indent=2).encode())
    with replacing(folder / "index.html") as file:
        file.write(_page(inversions).encode())
    return inversions


def _page(inversions: list[Inversion]) -> str:
    sections = [
        html.Section(
            heading=f"{inversion.source.spec.name} descriptor",
            text=f"{' x '.join(map(str, inversion.source.descriptor.shape))} numbers (rows, columns, channels). "
            f"The minimiser stopped after {inversion.seconds:.1f} s: {inversion.stop_reason}.",
            panels=inversion.panels(),
        )
        for inversion in inversions
    ]
    return html.page(
        "A photograph from its HOG descriptor",
        LEAD,
        [inversion.row() for inversion in inversions],
        sections,
        DEFINITIONS,
        f"Made by nablahog {version('nablahog')}. The photograph, Eileen Collins by NASA, is in the public domain and "
        "comes with scikit-image.",
    )
