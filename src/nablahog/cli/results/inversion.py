"""Inversion of sources in batches: images, figures and files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from ... import metrics
from ...hog.gradient import gray
from ...invert import AsPublished, Search, reconstruct, reconstruct_samples
from ...invert.colour import reconstruct_colour
from ...invert.learned import PriorChoice
from ...invert.options import QualityName
from ...io.images import write_image
from ...viz.pictures import Panel, contact_sheet, difference, glyphs
from ..inputs.sources import Source

MEASURES = {
    "CC": metrics.cross_correlation,
    "MI": metrics.mutual_information,
    "SSIM": metrics.ssim,
    "PSNR": metrics.psnr,
}
SURE = 0.8  # confidence in the polarity, below which the negative is shown, too
BATCH_PIXELS = 2**21  # 32 images of 256x256: results are written after each batch


@dataclass(frozen=True, kw_only=True)
class InversionOptions:
    """How descriptors are inverted.

    Attributes:
        seed: of the starting images.
        quality: as :func:`nablahog.reconstruct` has it.
        max_evaluations: of the objective; None for those of the quality.
        published: the paper's search, instead of the default one.
        samples: further answers to unsigned descriptors, by their prior; None for none.
        colour: whether to find images in colour, without a prior.
    """

    seed: int
    quality: QualityName = "best"
    max_evaluations: int | None = None
    published: AsPublished | None = None
    samples: int | None = None
    colour: bool = False


@dataclass(frozen=True, eq=False)
class Inversion:
    """A source with its pre-image and figures.

    Attributes:
        source: the input.
        preimage: (H, W), or (3, H, W) in colour, float32 in 0…1, on the CPU.
        reference: the gray photograph (Eq. 1) it is compared with, (H, W) in 0…1; None if it is not known.
        measures: CC, MI, SSIM and PSNR of the gray pre-image, and the distance, as
            :data:`nablahog.metrics.DEFINITIONS` has them; None where the reference is not known, or the measure not
            defined or not finite.
        seconds: the source's share of the time of its batch.
        stop_reason: why the minimiser stopped.
        iterates: (iterations + 1, H, W) in 0…1, from the start to the pre-image, if they were asked for.
        polarity: the learned prior's probability that the pre-image is no negative; None of signed descriptors, which
            tell, and without a prior.
        samples: (K, H, W) in 0…1, further answers that the prior thinks possible, if they were asked for.
        agreement: of the samples, as :class:`nablahog.invert.Samples` has it.
    """

    source: Source
    preimage: Tensor
    reference: Tensor | None
    measures: dict[str, float | None]
    seconds: float
    stop_reason: str
    iterates: Tensor | None = None
    polarity: float | None = None
    samples: Tensor | None = None
    agreement: float | None = None

    def figures(self) -> dict[str, Any]:
        """What ``results.json`` says of this input, ready for JSON."""
        return {
            "input": self.source.path,
            "descriptor": self.source.spec.name,
            **{name.lower(): value for name, value in self.measures.items()},
            "polarity": self.polarity,
            "agreement": self.agreement,
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
            **self.measures,
            "polarity": self.polarity,
            "seconds": self.seconds,
        }

    def terminal_row(self) -> dict[str, object]:
        """:meth:`row` without PSNR and polarity, so that it fits 80 columns."""
        return {name: value for name, value in self.row().items() if name not in ("PSNR", "polarity")}

    @property
    def unsure(self) -> bool:
        """Whether it may well be a negative."""
        return self.polarity is not None and self.polarity < SURE

    def panels(self) -> list[Panel]:
        """The pictures to show side by side: photograph and difference only where the photograph is known."""
        of, spec = self.source.name, self.source.spec
        drawn = [
            Panel(self.glyphs, f"glyphs, {spec.name}", f"Strokes along the edges of {of}, cell by cell, of its HOG"),
            Panel(self.preimage, "pre-image", f"The image found from the {spec.name} HOG of {of} alone"),
        ]
        if self.polarity is not None and self.unsure:
            negative = f"The negative of the image found from the HOG of {of}, which has the same HOG"
            drawn.append(Panel(1 - self.preimage, f"or its negative, {1 - self.polarity:.0%}", negative))
        if self.source.photo is None or self.reference is None:
            return drawn
        apart = difference(_gray(self.preimage), self.reference)
        seen = "Gray where pre-image and photograph agree, bright where the pre-image is brighter"
        return [
            Panel(self.source.photo, "photograph", f"The photograph {of}"),
            *drawn,
            Panel(apart, "pre-image - photograph", f"{of}: {seen}"),
        ]

    def sampled(self) -> list[Panel]:
        """The pre-image and the samples, if there are any."""
        if self.samples is None:
            return []
        about = f"A further image with about the HOG of {self.source.name}, that the prior thinks possible"
        drawn = [Panel(sample, f"sample {k}", about) for k, sample in enumerate(self.samples, start=1)]
        return [Panel(self.preimage, "pre-image", f"The image found from the HOG of {self.source.name} alone"), *drawn]

    def without_pictures(self) -> Inversion:
        """The same with its figures alone, which take little memory."""
        source = replace(self.source, descriptor=self.source.descriptor[:0], photo=None)
        return replace(self, source=source, preimage=self.preimage[:0], reference=None, iterates=None, samples=None)

    def pair(self) -> tuple[Panel, Panel] | None:
        """The gray photograph, where it is known, and the pre-image."""
        if self.reference is None:
            return None
        of = self.source.name
        preimage = Panel(self.preimage, "pre-image", f"The image found from the HOG of {of} alone")
        return Panel(self.reference, "photograph", f"The photograph {of} in gray"), preimage

    @cached_property
    def glyphs(self) -> NDArray[Any]:
        """The glyphs of the input descriptor, as :func:`nablahog.viz.pictures.glyphs` draws them."""
        return glyphs(self.source.descriptor, self.source.spec)

    def write(self, folder: Path) -> None:
        """Writes ``<stem>_preimage.png``, ``_glyphs.png``, ``_thumbnails.png``; ``_iterations.png``, ``_samples.png``.

        The last two if there are iterates, and samples.

        Raises:
            OSError: a file cannot be written.
        """
        further = {"iterations": self._first_and_last(), "samples": self.sampled()}
        more = {name: panels for name, panels in further.items() if panels}
        sheets = [contact_sheet([panels]) for panels in (self.panels(), *more.values())]  # all, before any is written
        preimage, glyph_picture, *names = (folder / name for name in result_names(self.source, list(more)))
        write_image(preimage, self.preimage)
        write_image(glyph_picture, self.glyphs)
        for name, sheet in zip(names, sheets, strict=True):
            write_image(name, sheet)

    def _first_and_last(self) -> list[Panel]:
        """The photograph, if it is known, and the iterates 0, 1, 2 and the last, as the paper shows them."""
        if self.iterates is None:
            return []
        last = len(self.iterates) - 1
        shown = [Panel(self.iterates[k], f"iteration {k}") for k in range(min(3, last))]
        photo = [] if self.source.photo is None else [Panel(self.source.photo, "photograph")]
        return [*photo, *shown, Panel(self.iterates[last], f"iteration {last}")]


def result_names(source: Source, more: Sequence[str] = ()) -> list[str]:
    """The names of the files that :meth:`Inversion.write` leaves, with ``more`` of them than are always there."""
    return [f"{source.stem}_{what}.png" for what in ("preimage", "glyphs", "thumbnails", *more)]


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
    options: InversionOptions,
    prior: PriorChoice = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Inversion]:
    """Inverts sources of one spec and image size together.

    Args:
        sources: at least one.
        device: where to compute.
        options: of the search.
        prior: as :func:`nablahog.reconstruct` has it.
        progress: called with the evaluations done and their largest number.

    Returns:
        One inversion for each source, in order.

    Raises:
        ValueError: as :func:`nablahog.reconstruct`; the prior was learned for another spec; colour with a spec of
            gray images.
    """
    descriptors = torch.stack([source.descriptor for source in sources]).to(device)
    spec, image_size = sources[0].spec, sources[0].image_size
    every: dict[str, Any] = {"seed": options.seed, "progress": progress}
    ours = {**every, "quality": options.quality, "search": Search(max_evaluations=options.max_evaluations)}
    if options.published is not None:
        result = reconstruct(descriptors, spec, image_size, method=options.published, **every)
    elif options.colour:
        result = reconstruct_colour(descriptors, spec, image_size, **ours)
    else:
        result = reconstruct(descriptors, spec, image_size, prior=prior, **ours)
    drawn = None
    if options.samples is not None and prior is not None and result.polarity_confidence is not None:
        drawn = reconstruct_samples(descriptors, spec, image_size, count=options.samples, prior=prior, **ours)
    inversions = []
    for index, source in enumerate(sources):
        preimage = result.image[index].detach().float().cpu()
        preimage = preimage if options.colour else preimage[0]
        reference = source.gray_photo
        measures = _measures(_gray(preimage), reference, float(result.distance[index]))
        seconds, stop_reason = result.seconds / len(sources), str(result.stop_reason[index])
        iterates = None if result.iterates is None else result.iterates[:, index, 0].detach().float().cpu()
        polarity = None if result.polarity_confidence is None else _rounded(result.polarity_confidence[index])
        further = None if drawn is None else drawn.image[index, :, 0].float().cpu()
        agreement = None if drawn is None else _rounded(drawn.agreement[index])
        inversions.append(
            Inversion(
                source,
                preimage,
                reference,
                measures,
                seconds,
                stop_reason,
                iterates,
                polarity,
                further,
                agreement,
            )
        )
    return inversions


def _rounded(value: Tensor) -> float:
    return round(float(value), 4)


def _gray(preimage: Tensor) -> Tensor:
    """(H, W), by Eq. 1, of an image (H, W) or (3, H, W)."""
    return preimage if preimage.dim() == 2 else gray(preimage[None])[0, 0].clamp(0, 1)


def _measures(preimage: Tensor, reference: Tensor | None, distance: float) -> dict[str, float | None]:
    figures = {name: measure(preimage, reference) for name, measure in MEASURES.items() if reference is not None}
    finite = {name: value for name, value in {**figures, "distance": distance}.items() if math.isfinite(value)}
    return {name: finite.get(name) for name in (*MEASURES, "distance")}  # JSON: no NaN, no infinity
