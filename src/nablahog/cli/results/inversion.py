"""Inverting a list of sources in batches, with the figures of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from ... import metrics
from ...hog.gradient import gray
from ...invert import LearnedPrior, reconstruct
from ...invert.colour import reconstruct_colour
from ...invert.quality import QualityName
from ...io.files import replacing
from ...io.images import write_image
from ...viz.pictures import Panel, contact_sheet, difference, glyphs
from ..inputs.sources import Source

BATCH_PIXELS = 2**21  # 32 images of 256x256: after each batch, what has been found is written


@dataclass(frozen=True)
class Inversion:
    """A source with its pre-image and figures.

    Attributes:
        source: the input.
        preimage: (H, W), or (3, H, W) in colour, float32 in 0…1, on the CPU.
        reference: the gray photograph (Eq. 1) it is compared with, (H, W) in 0…1; None if it is not known.
        cc, mi, ssim: of the gray pre-image, see :mod:`nablahog.metrics`; None where the reference is not known or the
            measure not defined.
        distance: relative distance ‖φ(x) − d‖ / ‖d‖; None where it is not finite.
        seconds: the source's share of the time of its batch.
        stop_reason: why the minimiser stopped.
    """

    source: Source
    preimage: Tensor
    reference: Tensor | None
    cc: float | None
    mi: float | None
    ssim: float | None
    distance: float | None
    seconds: float
    stop_reason: str

    def figures(self) -> dict[str, Any]:
        """What ``results.json`` says of this input, ready for JSON."""
        return {
            "input": self.source.path,
            "descriptor": self.source.spec.name,
            "cc": self.cc,
            "mi": self.mi,
            "ssim": self.ssim,
            "distance": self.distance,
            "seconds": round(self.seconds, 4),
            "stop_reason": self.stop_reason,
            "image_size": list(self.source.image_size),
            "cell_size": list(self.source.spec.cell_size),
            "preimage": result_names(self.source)[0],
        }

    def row(self) -> dict[str, object]:
        """The figures for a table, under the names of :data:`nablahog.metrics.DEFINITIONS`."""
        return {
            "input": self.source.path,
            "descriptor": self.source.spec.name,
            "size": "x".join(map(str, self.source.image_size)),
            "CC": self.cc,
            "MI": self.mi,
            "SSIM": self.ssim,
            "distance": self.distance,
            "seconds": self.seconds,
        }

    def panels(self) -> list[Panel]:
        """The pictures to show side by side: photograph and difference only where the photograph is known."""
        drawn = [Panel(self.glyphs(), f"glyphs, {self.source.spec.name}"), Panel(self.preimage, "pre-image")]
        if self.source.photo is None or self.reference is None:
            return drawn
        compared = Panel(difference(_gray(self.preimage), self.reference), "pre-image - photograph")
        return [Panel(self.source.photo, "photograph"), *drawn, compared]

    def glyphs(self) -> NDArray[Any]:
        """The glyph picture of the given descriptor, as :func:`nablahog.viz.pictures.glyphs` draws it."""
        return glyphs(self.source.descriptor, self.source.spec)

    def write(self, folder: Path) -> None:
        """Writes ``<stem>_preimage.png``, ``<stem>_glyphs.png`` and ``<stem>_thumbnails.png`` into ``folder``.

        Raises:
            OSError: a file cannot be written.
        """
        preimage, drawn, thumbnails = (folder / name for name in result_names(self.source))
        write_image(preimage, self.preimage)
        write_image(drawn, self.glyphs())
        with replacing(thumbnails) as file:
            contact_sheet([self.panels()]).save(file, format="PNG")


def result_names(source: Source) -> list[str]:
    """The names of the files that :meth:`Inversion.write` leaves."""
    return [f"{source.stem}_{what}.png" for what in ("preimage", "glyphs", "thumbnails")]


def batches(sources: Sequence[Source]) -> list[list[int]]:
    """Indices of sources of one spec and image size together, at most ``BATCH_PIXELS`` pixels in a batch."""
    groups: dict[object, list[int]] = {}
    for index, source in enumerate(sources):
        groups.setdefault((source.spec, source.image_size), []).append(index)
    result = []
    for members in groups.values():
        at_once = max(1, BATCH_PIXELS // math.prod(sources[members[0]].image_size))
        result += [members[start : start + at_once] for start in range(0, len(members), at_once)]
    return result


def invert_batch(
    sources: Sequence[Source],
    *,
    device: torch.device,
    seed: int,
    quality: QualityName = "best",
    max_evaluations: int | None = None,
    prior: LearnedPrior | None = None,
    colour: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> list[Inversion]:
    """Inverts sources of one spec and image size together.

    Args:
        sources: at least one.
        device: where to compute.
        seed: of the starting images.
        quality: as :func:`nablahog.reconstruct` has it.
        max_evaluations: of the objective; None for those of the quality.
        prior: what to expect of the images, learned for the spec; None for nothing learned.
        colour: whether images in colour are found, not gray ones; nothing learned is used then.
        progress: called with the evaluations done and their largest number.

    Returns:
        One inversion for each source, in order.

    Raises:
        ValueError: as :func:`nablahog.reconstruct`; the prior was learned for another spec, or the spec is of gray
            images, which none in colour is found for.
    """
    descriptors = torch.stack([source.descriptor for source in sources]).to(device)
    limit: dict[str, Any] = {} if max_evaluations is None else {"max_evaluations": max_evaluations}
    spec, image_size = sources[0].spec, sources[0].image_size
    find = reconstruct_colour if colour else reconstruct if prior is None else prior.reconstruct
    result = find(descriptors, spec, image_size, quality=quality, seed=seed, progress=progress, **limit)
    inversions = []
    for index, source in enumerate(sources):
        preimage = result.image[index].detach().float().cpu()
        preimage = preimage if colour else preimage[0]
        reference = None if source.photo is None else gray(source.photo[None])[0, 0]
        inversion = Inversion(
            source,
            preimage,
            reference,
            **_compared(_gray(preimage), reference),
            distance=_finite(float(result.distance[index])),
            seconds=result.seconds / len(sources),
            stop_reason=str(result.stop_reason[index]),
        )
        inversions.append(inversion)
    return inversions


def _gray(preimage: Tensor) -> Tensor:
    """(H, W), by Eq. 1, of an image (H, W) or (3, H, W)."""
    return preimage if preimage.dim() == 2 else gray(preimage[None])[0, 0].clamp(0, 1)


def _compared(preimage: Tensor, reference: Tensor | None) -> dict[str, float | None]:
    measures = {"cc": metrics.cross_correlation, "mi": metrics.mutual_information, "ssim": metrics.ssim}
    if reference is None:
        return dict.fromkeys(measures)
    return {name: _finite(measure(preimage, reference)) for name, measure in measures.items()}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None  # JSON knows no NaN
