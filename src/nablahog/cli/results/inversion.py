"""Inversion of sources in batches: images, figures and files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ...invert import AsPublished, reconstruct, reconstruct_samples
from ...invert.prior.choice import PriorChoice
from ...invert.template import reconstruct_template
from ...io.images import Picture, write_image
from ...metrics import MEASURES
from ...requests.inversion import SURE, InvertRequest
from ...requests.sources import Source
from ...viz.pictures import Panel, contact_sheet, difference, fade_unsure, glyphs
from ..terminal import inform, say

PICTURES = ("preimage", "glyphs", "thumbnails", "regions", "iterations", "samples")
NAMED = 5  # pre-images of uncertain polarity that are named on the terminal
BATCH_PIXELS = 2**21  # 32 images of 256x256: results are written after each batch


@dataclass(frozen=True, eq=False)
class Inversion:
    """A source with its pre-image and figures.

    Images are (H, W), float32 in 0…1, on the CPU.

    Attributes:
        measures: CC, MI, SSIM and PSNR of the gray pre-image, and the distance, see
            :data:`nablahog.metrics.DEFINITIONS`; None where the photograph is not known or the measure is not finite.
        seconds: the source's share of the time of its batch.
        iterates: by their number: the images after 0, 1, 2 and all iterations of the paper's search.
        polarity: the learned prior's probability that the pre-image as a whole is not a negative; None for signed
            descriptors, for templates, and without a prior.
        sure_regions: the share of pixels for which the prior is at least 0.8 sure that the region around them is
            rightly bright or dark; regions that it is sure are wrong do not count.  None as before.
        regions: (H, W) in 0…1, its probability that they are rightly bright or dark; None as before.
        samples: (K, H, W), further answers that the prior thinks possible, if they were asked for.
        agreement: of the samples, see :class:`nablahog.invert.Samples`.
    """

    source: Source
    preimage: Tensor
    measures: dict[str, float | None]
    seconds: float
    stop_reason: str
    iterates: Mapping[int, Tensor] = field(default_factory=dict)
    polarity: float | None = None
    sure_regions: float | None = None
    regions: Tensor | None = None
    samples: Tensor | None = None
    agreement: float | None = None

    def figures(self) -> dict[str, Any]:
        """The figures of ``results.json``, ready for JSON."""
        return {
            "input": self.source.path,
            "descriptor": self.source.spec.name,
            **{name.lower(): value for name, value in self.measures.items()},
            "polarity": self.polarity,
            "sure_regions": self.sure_regions,
            "agreement": self.agreement,
            "seconds": round(self.seconds, 4),
            "stop_reason": self.stop_reason,
            "image_size": list(self.source.image_size),
            "cell_size": list(self.source.spec.cell_size),
            "preimage": picture_name(self.source, "preimage"),
        }

    def row(self) -> dict[str, object]:
        """The figures for a table, with the names of :data:`nablahog.metrics.DEFINITIONS`."""
        return {
            "input": f"{self.source.path}, {self.source.part}" if self.source.part else self.source.path,
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
        """Whether the pre-image may as well be a negative."""
        return self.polarity is not None and self.polarity < SURE

    def panels(self) -> list[Panel]:
        """The pictures to show side by side: photograph and difference only where the photograph is known."""
        of, spec, photo = self.source.name, self.source.spec, self.source.photo
        drawn = [
            Panel(self.glyphs, f"glyphs, {spec.name}", f"Strokes along the edges of {of}, cell by cell, of its HOG"),
            Panel(self.preimage, "pre-image", f"The image found from the {spec.name} HOG of {of} alone"),
        ]
        if self.unsure or (self.source.part and not spec.signed):  # no prior says which, for parts of a template
            odds = "" if self.polarity is None else f", {1 - self.polarity:.0%}"
            negative = f"The negative of the image found from the HOG of {of}, which has the same HOG"
            drawn.append(Panel(1 - self.preimage, f"or its negative{odds}", negative))
        if self.faded is not None:
            gray = f"The same image, the grayer the less sure it is that a region of {of} is rightly bright or dark"
            drawn.insert(2, Panel(self.faded, "gray where unsure", gray))
        if photo is None or self.source.gray_photo is None:
            return drawn
        apart = difference(self.preimage, self.source.gray_photo)
        seen = "Gray where pre-image and photograph agree, bright where the pre-image is brighter"
        return [
            Panel(photo, "photograph", f"The photograph {of}"),
            *drawn,
            Panel(apart, "pre-image - photograph", f"{of}: {seen}"),
        ]

    def sampled(self) -> list[Panel]:
        """The pre-image and the samples, if there are any."""
        if self.samples is None:
            return []
        about = f"A further image with about the HOG of {self.source.name}, that the prior thinks possible"
        drawn = [Panel(sample, f"sample {k}", about) for k, sample in enumerate(self.samples, start=1)]
        return [self.panel, *drawn]

    def without_pictures(self) -> Inversion:
        """A copy with the figures alone, which takes little memory."""
        source = replace(self.source, descriptor=self.source.descriptor[:0], photo=None)
        return replace(self, source=source, preimage=self.preimage[:0], regions=None, iterates={}, samples=None)

    @property
    def panel(self) -> Panel:
        return Panel(self.preimage, "pre-image", f"The image found from the HOG of {self.source.name} alone")

    @cached_property
    def glyphs(self) -> NDArray[Any]:
        """The glyphs of the input descriptor, or of the positive weights of a template."""
        return glyphs(self.source.descriptor.clamp(min=0), self.source.spec)

    @cached_property
    def faded(self) -> NDArray[Any] | None:
        """The pre-image, gray where it is not known what is bright, or probably wrong; None as ``regions``."""
        return None if self.regions is None else fade_unsure(self.preimage, self.regions, SURE)

    def write(self, folder: Path) -> None:
        """Writes a picture for each of :data:`PICTURES`; the last three only if the inversion has them."""
        # all are drawn before any is written
        rows = {"thumbnails": self.panels(), "iterations": self._first_and_last(), "samples": self.sampled()}
        sheets = {what: contact_sheet([panels]) for what, panels in rows.items() if panels}
        pictures: dict[str, Picture | Image.Image] = {"preimage": self.preimage, "glyphs": self.glyphs, **sheets}
        if self.faded is not None:
            pictures["regions"] = self.faded
        for what, picture in pictures.items():
            write_image(folder / picture_name(self.source, what), picture)

    def _first_and_last(self) -> list[Panel]:
        """The photograph, if it is known, and the iterates, as the paper shows them."""
        if not self.iterates:
            return []
        photo = [] if self.source.photo is None else [Panel(self.source.photo, "photograph")]
        return [*photo, *(Panel(image, f"iteration {k}") for k, image in self.iterates.items())]


def say_unsure(inversions: Sequence[Inversion]) -> None:
    """Names the pre-images whose negatives may as well be right."""
    unsure = [f"{each.source.name} ({1 - (each.polarity or 0):.0%})" for each in inversions if each.unsure]
    if unsure:
        more = ", …" if len(unsure) > NAMED else ""
        listed = ", ".join(unsure[:NAMED])
        say(f"These may be negatives, with bright and dark exchanged (probability in brackets): {listed}{more}")


def picture_name(source: Source, what: str) -> str:
    """The name of the file that :meth:`Inversion.write` writes for one of :data:`PICTURES`."""
    return f"{source.stem}_{what}.png"


def batches(sources: Sequence[Source]) -> list[list[int]]:
    """Groups indices of sources by spec and image size, with at most :data:`BATCH_PIXELS` pixels in a batch."""
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
    request: InvertRequest,
    *,
    device: torch.device,
    progress: Callable[[int, int], None] | None = None,
) -> list[Inversion]:
    """The inversions of sources of one spec and image size, searched together; templates only one at a time.

    ``progress`` is called with the number of evaluations done and the most there can be.
    """
    descriptors = torch.stack([source.descriptor for source in sources]).to(device)
    spec, image_size = sources[0].spec, sources[0].image_size
    if request.template:
        seed = request.seed
        result = reconstruct_template(descriptors, spec, image_size, seed=seed, progress=progress)
    else:
        prior = _priors_for(sources[0], request)
        asked = {**request.keywords(), "prior": prior, "progress": progress}
        if request.method == "paper":
            asked["method"] = AsPublished(keep_iterates=True)
        result = reconstruct(descriptors, spec, image_size, **asked)
    drawn = None
    if request.samples is not None and prior is not None and result.polarity_confidence is not None:
        drawn = reconstruct_samples(descriptors, spec, image_size, count=request.samples, **asked)
    polarity, confidences = result.polarity_confidence, result.region_confidence
    inversions = []
    for index, source in enumerate(sources):
        preimage = result.image[index, 0].detach().float().cpu()
        kept = () if result.iterates is None else result.iterates[:, index, 0].detach().float().cpu()
        inversion = Inversion(
            source,
            preimage,
            _measures(preimage, source.gray_photo, float(result.distance[index])),
            result.seconds / len(sources),
            str(result.stop_reason[index]),
            {k: kept[k] for k in sorted({0, 1, 2, len(kept) - 1}) if 0 <= k < len(kept)},
            None if polarity is None else round(float(polarity[index]), 4),
            None if confidences is None else round(float((confidences[index] >= SURE).double().mean()), 4),
            None if confidences is None else confidences[index, 0].float().cpu(),
            None if drawn is None else drawn.image[index, :, 0].float().cpu(),
            None if drawn is None else round(float(drawn.agreement[index]), 4),
        )
        inversions.append(inversion)
    return inversions


def _priors_for(source: Source, request: InvertRequest) -> PriorChoice:
    """The priors for a source; none, and a line on stderr, if those of the package were not installed."""
    try:
        return request.priors_for(source.spec)
    except FileNotFoundError as error:
        if request.prior_file is not None:
            raise
        _inform_once(f"Inverting without a learned prior: {error}")
        return None


_inform_once = cache(inform)


def _measures(preimage: Tensor, reference: Tensor | None, distance: float) -> dict[str, float | None]:
    figures = {name: measure(preimage, reference) for name, measure in MEASURES.items() if reference is not None}
    finite = {name: value for name, value in {**figures, "distance": distance}.items() if math.isfinite(value)}
    return {name: finite.get(name) for name in (*MEASURES, "distance")}  # JSON: no NaN, no infinity
