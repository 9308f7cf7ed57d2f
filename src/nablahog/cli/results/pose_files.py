"""Poses of objects as files: CSV, JSON like COCO's, and pages."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ...io.files import write_text
from ...jobs.store import JobResult
from ...paper.object_lists import ListedObject
from ...viz import html
from ...viz.pictures import Panel
from .pose_figures import DEFINITIONS

SHOWN = 200  # objects with a picture on the page
LEAD = "The poses at which renderings of CAD models have the HOG most like that of objects in photographs."
_POSE = ("azimuth", "elevation", "theta", "distance", "distance_in_file_units", "x", "y")
_CAMERA = ("focal_length", "focal_length_from")
_SIDES = ("x0", "y0", "x1", "y1")
_MATRIX = [(row, col) for row in range(3) for col in range(4)]


@dataclass(frozen=True, eq=False)
class PosedObject:
    """An object with its pose.

    Attributes:
        listed: what was known of it.
        figures: of :func:`.pose_figures.pose_figures`; None where there is no pose.
        picture: (3, H, W), uint8.
        page: HTML, if pages were asked for.
        failure: one sentence why there is no pose.
    """

    listed: ListedObject
    figures: Mapping[str, Any] | None
    picture: NDArray[Any] | None = None
    page: str | None = None
    failure: str = ""

    @classmethod
    def of(cls, listed: ListedObject, result: JobResult | str) -> PosedObject:
        """That of an object and the result of its :class:`.pose_job.ObjectJob`."""
        if isinstance(result, str):
            return cls(listed, None, failure=result)
        figures = dict(result.figures[0])
        return cls(listed, figures, result.pictures[0], figures.pop("page", None))

    def refused(self, least_confidence: float) -> bool:
        """Whether the pose is less sure than was asked for."""
        sure = None if self.figures is None else self.figures["confidence"]
        return sure is not None and sure < least_confidence


def names(objects: Sequence[ListedObject], pages: bool) -> list[str]:
    """The names of the files that :func:`write` leaves."""
    return ["poses.csv", "poses.json", "index.html", *(_page_name(one) for one in objects if pages)]


def _page_name(one: ListedObject) -> str:
    return f"object_{one.id}.html"


def write(folder: Path, objects: Sequence[PosedObject], least_confidence: float) -> None:
    """Writes the files of :func:`names`; all are made before the first is written.

    Raises:
        OSError: a file cannot be written.
    """
    texts = {
        "poses.csv": as_csv(objects, least_confidence),
        "poses.json": json.dumps(as_json(objects, least_confidence), indent=1, allow_nan=False) + "\n",
        "index.html": _page(objects, least_confidence),
        **{_page_name(one.listed): one.page for one in objects if one.page is not None},
    }
    for name, text in texts.items():
        write_text(folder / name, text)


def as_csv(objects: Sequence[PosedObject], least_confidence: float) -> str:
    """A line for each object, which :func:`nablahog.paper.object_lists.read_objects` reads again.

    m00 … m23 are the upper three rows of the matrix, row by row.
    """
    out = io.StringIO()
    matrix = [f"m{row}{col}" for row, col in _MATRIX]
    columns = [
        "image",
        "id",
        *_SIDES,
        "model",
        *_POSE,
        *_CAMERA,
        "similarity",
        "confidence",
        "refused",
        *matrix,
        "error",
    ]
    writer = csv.DictWriter(out, columns, lineterminator="\n", restval="")
    writer.writeheader()
    for one in objects:
        row: dict[str, Any] = {"image": one.listed.image, "id": one.listed.id, "error": one.failure}
        box = one.listed.box
        if one.figures is not None:
            figures = one.figures
            row |= {name: figures[name] for name in ("model", *_POSE, *_CAMERA, "similarity", "confidence")}
            row |= {name: figures["matrix"][at[0]][at[1]] for name, at in zip(matrix, _MATRIX, strict=True)}
            row["refused"] = one.refused(least_confidence)
            box = figures["box"]
        row |= {} if box is None else dict(zip(_SIDES, box, strict=True))
        writer.writerow(row)
    return out.getvalue()


def as_json(objects: Sequence[PosedObject], least_confidence: float) -> dict[str, Any]:
    """All figures, ready for JSON, in COCO's form: images, categories, which are models, and annotations."""
    posed = [one for one in objects if one.figures is not None]
    images = {name: k for k, name in enumerate(dict.fromkeys(one.listed.image for one in objects), 1)}
    sizes = {one.listed.image: one.figures["image_size"] for one in posed if one.figures is not None}
    models = {name: k for k, name in enumerate(sorted({one.figures["model"] for one in posed if one.figures}), 1)}
    annotations = []
    for one in posed:
        assert one.figures is not None
        figures = {name: value for name, value in one.figures.items() if name not in ("image_size", "box")}
        x0, y0, x1, y1 = one.figures["box"]
        annotations.append(
            {
                "id": one.listed.id,
                "image_id": images[one.listed.image],
                "category_id": models[one.figures["model"]],
                "bbox": [x0, y0, x1 - x0, y1 - y0],
                "area": (x1 - x0) * (y1 - y0),
                "iscrowd": 0,
                **figures,
                "refused": one.refused(least_confidence),
            }
        )
    return {
        "info": {"description": LEAD, "version": version("nablahog")},
        "images": [
            {"id": k, "file_name": name, **dict(zip(("height", "width"), sizes.get(name, ()), strict=False))}
            for name, k in images.items()
        ],
        "categories": [{"id": k, "name": name} for name, k in models.items()],
        "annotations": annotations,
        "failed": [
            {"id": one.listed.id, "file_name": one.listed.image, "error": one.failure}
            for one in objects
            if one.figures is None
        ],
        "definitions": DEFINITIONS,
    }


def rows(objects: Sequence[PosedObject]) -> list[dict[str, object]]:
    """The most important figures, for a table."""
    shown = ("model", "azimuth", "elevation", "theta", "distance", "similarity", "confidence")
    return [
        {
            "photograph": os.fsencode(one.listed.image).decode(errors="backslashreplace"),
            "object": one.listed.id,
            **{name: None if one.figures is None else one.figures[name] for name in shown},
            **({"azimuth": "any"} if one.figures is not None and one.figures["any_azimuth"] else {}),
        }
        for one in objects
    ]


def _page(objects: Sequence[PosedObject], least_confidence: float) -> str:
    panels = []
    for one in objects[:SHOWN]:
        if one.figures is not None and one.picture is not None:
            name = f"{one.listed.image}, {one.listed.id}"
            panels.append(Panel(one.picture / 255, name, f"The object with the outline of {one.figures['model']}"))
    failed = [{"photograph": one.listed.image, "why": one.failure} for one in objects if one.figures is None]
    first = "" if len(objects) <= SHOWN else f" Of the first {SHOWN}."
    sections = [html.Section("Outlines", f"Each object with the outline of the model that fits best.{first}", panels)]
    if failed:
        sections.append(html.Section("No pose", "Objects without a pose, and why.", table=failed))
    refused = sum(one.refused(least_confidence) for one in objects)
    lead = f"{LEAD} {refused} of {len(objects)} have a confidence below {least_confidence:g}."
    definitions = {name: text for name, text in DEFINITIONS.items() if name in rows(objects[:1])[0]}
    return html.page("Poses", lead, rows(objects), sections, definitions, html.footer("poses.json and poses.csv"))
