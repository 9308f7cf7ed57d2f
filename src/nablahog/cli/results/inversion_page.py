"""The page of inversions, of ``nablahog invert`` and ``nablahog demo``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...metrics import DEFINITIONS
from ...requests.inversion import SURE
from ...viz import html
from ...viz.pictures import Panel
from .inversion import Inversion

SHOWN_INPUTS = 24  # inputs with pictures, which are inlined: a page of hundreds would not open
TITLE = "Images from HOG descriptors"
LEAD = (
    "Each image was found from a HOG descriptor alone. A photograph is not an input of the inversion; if there is "
    "one, it is shown for comparison. HOG contains neither colour nor brightness, so the pre-image is gray, and is "
    "compared with the gray photograph. In the difference, middle gray means equal. Many images have nearly the same "
    "descriptor; a learned prior chooses one that looks like a photograph, unless --prior none was given."
)
TEMPLATES = (
    "The positive weights of a linear detector over a HOG descriptor say which edges speak for a detection, and the "
    "negative ones which speak against it. Each image was found from the weights of one sign alone: its histograms are "
    "their squares, so a larger weight gives a stronger edge. Where gradients are unsigned, the negative of each image "
    "is as good."
)
POLARITY = (
    "Probability, by the learned prior, that the pre-image as a whole is not a negative; single regions may be wrong "
    "all the same. There is none without a prior, or for descriptors that tell bright from dark."
)
REGIONS = (
    "Opposite gradients share a bin, so the descriptor hardly tells which regions are bright. In {share:.0%} of the "
    f"image the prior is at least {SURE:.0%} sure that the pre-image is right about it. Elsewhere the picture is drawn "
    "the grayer, the less sure it is."
)
SAMPLES = "the mean magnitude of the correlation of two samples, 1 where all are alike; they can share a mistake"
FIGURES = {
    "input": "The file of the photograph, descriptor or detector.",
    "descriptor": "The kind of the descriptor: the name of its preset.",
    "size, image_size": "Height and width of the pre-image, in pixels.",
    "cell_size": "Height and width of a cell of the descriptor, in pixels.",
    **DEFINITIONS,
    "polarity": POLARITY,
    "sure_regions": f"Share of the image in which the prior is at least {SURE:.0%} sure that the pre-image is right "
    "about what is bright; none where there is no polarity.",
    "agreement": f"Of the samples: {SAMPLES}; none without --samples.",
    "seconds": "Wall time of the search; for inputs that share a search, an equal part of it.",
    "stop_reason": "Why the search ended.",
    "preimage": "The file of the pre-image, in the same folder.",
    "error": "Why an input has no pre-image.",
}
"""What the figures of the page and of its JSON file mean."""


def page(
    inversions: Sequence[Inversion],
    skipped: Sequence[Mapping[str, str]] = (),
    *,
    title: str = TITLE,
    lead: str = LEAD,
    figures: str = "results.json",
    remark: str = "",
) -> str:
    """The page: for each of the first inversions a section with its pictures, below a table of all."""
    shown = inversions[:SHOWN_INPUTS]
    rows = html.without_empty_columns([{**inversion.row(), "input": inversion.source.name} for inversion in inversions])
    more = f" The pictures of {len(shown)} of {len(inversions)} are below." if len(shown) < len(inversions) else ""
    return html.page(
        title,
        f"{lead}{more}",
        rows,
        [*map(_section, shown), html.Section("Skipped inputs", "These files could not be used.", table=skipped)],
        FIGURES,
        f"{html.footer(f'{figures} beside this page')} {remark}".rstrip(),
        first=_first(shown),
    )


def _first(inversions: Sequence[Inversion]) -> html.Section | None:
    """The first photograph that is known, to wipe to its pre-image."""
    for inversion in inversions:
        photo, name = inversion.source.gray_photo, inversion.source.name
        if photo is not None:
            compared = Panel(photo, "photograph", f"The photograph {name} in gray"), inversion.panel
            text = f"{name}: drag to see the photograph, or the image found from its HOG."
            return html.Section("", text, compared=compared)
    return None


def _section(inversion: Inversion) -> html.Section:
    source = inversion.source
    numbers = " x ".join(map(str, source.descriptor.shape))
    agreement, regions = inversion.agreement, inversion.sure_regions
    samples = "" if agreement is None else f" Agreement of the samples: {agreement:.2f}, {SAMPLES}."
    unsure = "" if regions is None else f" {REGIONS.format(share=regions)}"
    remark = f" Of the array, {source.remark}." if source.remark else ""
    return html.Section(
        f"{source.name}, {source.spec.name}",
        f"From {numbers} numbers (rows, columns, channels), in {inversion.seconds:.1f} s.{remark}{unsure}{samples}",
        [*inversion.panels(), *inversion.sampled()[1:]],
    )
