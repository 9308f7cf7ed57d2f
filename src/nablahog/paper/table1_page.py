"""Table 1 on the terminal and as a page."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from torch import Tensor

from .. import metrics
from ..hog import HOGSpec, hog
from ..invert.scales import SCALES
from ..io.photographs import Photographs
from ..viz import html
from ..viz.pictures import Panel, glyphs
from .learned import load
from .methods import ReconstructionMethod, Table1Settings
from .names import PRIORS
from .table1 import Table1, Table1Row
from .tables import RESAMPLES, Statistics, cell, count_failures, failures_section

HEADINGS = {
    "cc": "CC",
    "abs_cc": "|CC|",
    "mi": "MI",
    "ssim": "SSIM",
    "psnr": "PSNR",
    "distance": "distance",
}
TERMINAL = {metric: name for metric, name in HEADINGS.items() if metric != "psnr"}  # fits 80
LEVEL_IMAGES = 2  # for each method in the figure of the levels

DEFINITIONS = {
    "CC": metrics.DEFINITIONS["CC"],
    "|CC|": "The magnitude of CC, image by image, for descriptors that hardly tell an image from its negative.",
    **{name: text for name, text in metrics.DEFINITIONS.items() if name != "CC"},
    "mean, interval, median": "Over the images that the method has a result for and the measure is defined for; their "
    f"number is n. The interval holds the mean with 95 %: percentile bootstrap, {RESAMPLES:,} resamples of the images "
    "with a fixed seed. Of a few images it is too narrow.",
    "paper": "The mean that the paper prints, over the 101 images of its own, by measures of the same names that it "
    "does not define; a dash where it prints none.",
    "multi-scale": "Begins with an image of 1/64 of the pixels, with cells of 1/8 of the sides, and enlarges it in "
    "steps.",
    "multi-scale-more": "The same, but each level has the descriptor of the image shrunk to that level. That is "
    "more than the input of other methods, so, as the paper says, its figures are not comparable with theirs.",
    "learned": "Starts from, and stays close to, the image that a network expects for the descriptor. The network "
    "has learned from photographs; it is the one that comes with nablahog unless another is given.",
    "bovw": "The input is a histogram of visual words. The words are arranged like a jigsaw puzzle, by the positions "
    "and neighbours that they have in photographs (after Kato and Harada; many details are our own choice).",
    "hoggles": "Inverts each window with a pair of dictionaries, of descriptors and of patches (Vondrick et al.); all "
    "cells count, while theirs leaves out the outermost.",
    "cnn-hog, cnn-hogb": "HOG as a convolutional network, without texture channels, inverted by gradient descent under "
    "two priors (Mahendran and Vedaldi); the distance is that of the network's own descriptor.",
    "what libraries compute": "Single-scale, from the descriptor that a library computes, with its own defaults and "
    "cells of 8 pixels; opencv-linear is OpenCV's without the root of gray values (gammaCorrection), hog-net the "
    "network of cnn-hog, inverted as the others are.",
    "NAME@1/s": "A level of a multi-scale method: an image with an s-th of the pixels. To be compared with the "
    "photograph it is enlarged to its size (bicubic); its distance is that of the level's own image from the "
    "descriptor sought at that level. The row NAME is the last level, NAME@1/1.",
    "seconds": "Wall time of a method for one image, in a process that computes in one thread; of all levels together.",
    "method, metric, image": "In the files: a row of the table, a measure, and the file of a photograph.",
    "cc, abs_cc, mi, ssim, psnr": "In the files: CC, |CC|, MI, SSIM and PSNR.",
    "low, high": "In summary.csv: the ends of the interval.",
    "n": "In summary.csv: the number of images.",
    "reason": "In failures.csv: why a method has no result for an image.",
}
"""What each figure means, printed under the table."""

LEAD = (
    "Each image was described by its HOG descriptor, and an image with this descriptor was sought from the descriptor "
    "alone. The figures say how alike the two are on average, beside those of Table 1 of See the Difference (ICCV "
    "2015)."
)


def remarks(
    left_out: Sequence[ReconstructionMethod], learned: Mapping[str, Path], photographs: Photographs
) -> list[str]:
    """Which methods are left out, and why MI is; which methods have trained on the test images."""
    sentences = [
        f"{method.name} is optional, and runs with a file of {kind}, see `nablahog learn {PRIORS[kind]}`."
        for method in left_out
        for kind in method.needs[:1]
    ]
    if not photographs.equally_large:
        sentences.append(
            "The images differ in their number of pixels, on which the bias of MI depends, so MI has no mean here: "
            "per_image.csv has that of each."
        )
    for kind, path in learned.items():
        names = load(kind, path).learning.images
        common = {*names, *(name.split(", ")[0] for name in names)} & {*photographs.images}  # tiles say where they are
        if common:
            sentences.append(
                f"The {kind} file was learned from images of the same names as {len(common)} of these; if they are the "
                "same images, their figures say nothing about other images."
            )
    return sentences


def terminal_rows(table: Table1) -> list[dict[str, object]]:
    """The means, ours and the paper's, one mapping for each row, of the measures that are defined for any image.

    A level below its method has the name of its scale.
    """
    lines = table.table_rows()
    headings = {name: text for name, text in TERMINAL.items() if any(line.statistics[name].n for line in lines)}
    rows = [_row(line, lambda summary: summary.mean, headings) for line in lines]
    return [{**row, "method": re.sub("^.+@", "  @", str(row["method"]))} for row in rows]


def _row(line: Table1Row, figure: Callable[[Statistics], object], headings: Mapping[str, str]) -> dict[str, object]:
    """A row with ``figure`` of each measure of ``headings``, and the paper's of those that it prints."""
    row: dict[str, object] = {"method": line.row, "n": line.statistics["cc"].n}
    for metric, name in headings.items():
        row[name] = figure(line.statistics[metric])
        if metric in ("cc", "mi", "ssim"):
            row[f"{name}\npaper"] = line.paper[metric]
    return {**row, "seconds": line.seconds}


def page(table: Table1, settings: Table1Settings, origin: str, remarks: Sequence[str] = ()) -> str:
    """The page; ``origin`` says where the images are from; ``remarks`` follow it; both are whole sentences."""
    ignored = table.photographs.ignored
    passed_over = (
        f" Skipped, because their names do not end like those of images: {', '.join(ignored)}." if ignored else ""
    )
    text = "These are not in the figures above. A further run with the same settings tries them again."
    failures = failures_section(table.failures, "image", text)
    limit = f", at most {settings.max_evaluations} evaluations" if settings.max_evaluations else ""
    return html.page(
        "Table 1: images from HOG descriptors",
        " ".join([f"{LEAD} {origin}{count_failures(table.failures)}{passed_over}", *remarks]),
        list(_table(table.table_rows())),
        [failures, _pictures(table), _levels(table)],
        DEFINITIONS,
        html.footer(
            "summary.csv and per_image.csv beside this page, the times in times.csv", f", seed {settings.seed}{limit}"
        ),
    )


def _table(lines: Sequence[Table1Row]) -> Iterator[Mapping[str, object]]:
    group = None
    for line in lines:
        if line.group != group:
            group = line.group
            yield {"method": group}
        yield _row(line, lambda summary: cell(summary, summary.mean, f"median {html.figure(summary.median)}"), HEADINGS)


def _photograph(table: Table1, image: str) -> html.Cell:
    return html.Cell(Panel(table.photographs.images[image], image, f"The image {image}"), image)


def _output(table: Table1, row: str, image: str) -> html.Cell | None:
    """The output of a method above its figures; None where it failed."""
    picture, figures = table.pictures[row].get(image), table.figures[row].get(image)
    if picture is None or figures is None:
        return None
    remark = f"CC {html.figure(figures['cc'])}\nSSIM {html.figure(figures['ssim'])}"
    return html.Cell(Panel(picture / np.float64(255), f"{image}, {row}", f"What {row} made of {image}"), remark)


def _glyphs(image: str, pixels: Tensor, spec: HOGSpec) -> Panel | None:
    try:
        descriptor = hog(pixels[None, None], spec)[0]
    except ValueError:  # too small for this dialect, if not for another
        return None
    seen = f"Strokes along the edges of {image}, cell by cell, of its {spec.name} HOG"
    return Panel(glyphs(descriptor, spec), f"{image}, glyphs of {spec.name}", seen)


def _pictures(table: Table1) -> html.Section:
    specs: dict[str, set[HOGSpec]] = {}
    for method in table.methods:
        if method.spec is not None:
            specs.setdefault(method.group, set()).add(method.spec)
    described = {group: spec for group, (spec, *others) in specs.items() if not others}
    shown = {image for pictures in table.pictures.values() for image in pictures}
    rows = []
    for image, pixels in table.photographs.images.items():
        if image not in shown:
            continue
        row: dict[str, object] = {"image": _photograph(table, image)}
        row |= {group: _glyphs(image, pixels, spec) for group, spec in described.items()}
        rows.append(row | {method.name: _output(table, method.name, image) for method in table.methods})
    count = len(table.photographs.images)
    some = f" {len(rows)} of the {count} images, evenly spread over them." if len(rows) < count else ""
    text = f"The image, its descriptors as glyphs, and the output of each method.{some}"
    return html.Section("Pictures", text, table=rows)


def _levels(table: Table1) -> html.Section:
    rows: list[Mapping[str, object]] = []
    for method in table.methods:
        images = list(table.pictures[method.name])[:LEVEL_IMAGES]
        if method.levels and images:
            rows.append({"image": method.name})
            for image in images:
                levels = {f"1/{s}": _output(table, row, image) for s, row in zip(SCALES, method.levels, strict=True)}
                rows.append({"image": _photograph(table, image), **levels})
    text = "The image of each level, from the smallest to the size of the image, enlarged to that size."
    return html.Section("Levels", text, table=rows)
