"""Poses of objects as files: CSV, JSON like COCO's, and a page."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ...io.files import write_text
from ...io.lists import SIDES, AnnotatedObject
from ...jobs.store import JobResult
from ...runtime.text import guard_formula
from ...viz import html
from ...viz.pictures import Panel
from .pose_pictures import SEVERAL_MODELS
from .pose_table import (
    DEFINITIONS,
    MATRIX,
    POSITION,
    POSITIONS,
    PRINCIPAL_POINT,
    SECOND,
    define,
    get_deviation,
    say_assumed,
    show_figures,
    show_position,
)

SHOWN = 100  # objects with pictures on the page
LEAD = "The poses at which renderings of CAD models have the HOG most like that of objects in photographs."
_POSE = ("azimuth", "elevation", "theta", "distance", "distance_in_file_units", "x", "y")
_DEVIATIONS = [f"{name}_std" for name in _POSE]
_PLAIN = [
    *("model", *_POSE, "any_azimuth", "focal_length", "focal_length_from", "similarity", "similarity_kind"),
    *("confidence", "warning", "half_turn", "renderings", "seconds"),
]
"""Figures of one number or text."""
COLUMNS = [
    *("image", "id", *SIDES, *_PLAIN, "equivalent_azimuths", *_DEVIATIONS, *POSITION, *PRINCIPAL_POINT, *SECOND),
    *("refused", *MATRIX, "error"),
]
"""Those of poses.csv."""


@dataclass(frozen=True, eq=False)
class PosedObject:
    """An object with the figures of its pose and its joined pictures, uint8; without a pose, a sentence says why.

    ``page`` is HTML, if pages were asked for; ``refused`` is a pose that is less sure than was asked for.
    """

    listed: AnnotatedObject
    figures: Mapping[str, Any] = field(default_factory=dict)
    picture: NDArray[Any] | None = None
    page: str | None = None
    failure: str = ""
    refused: bool = False

    @classmethod
    def of(cls, listed: AnnotatedObject, result: JobResult | str, least_confidence: float) -> PosedObject:
        """Combines an object with the result of its :class:`.pose.ObjectJob`."""
        if isinstance(result, str):
            return cls(listed, failure=result)
        figures = dict(result.figures[0])
        page, confidence, _ = figures.pop("page", None), figures["confidence"], figures.pop("drawn_size")
        refused = confidence is not None and confidence < least_confidence
        return cls(listed, figures, result.pictures[0], page, refused=refused)


def names(objects: Sequence[AnnotatedObject], pages: bool) -> list[str]:
    """The names of the files that :func:`write` leaves."""
    return ["poses.csv", "poses.json", "index.html", *(_page_name(posed) for posed in objects if pages)]


def _page_name(posed: AnnotatedObject) -> str:
    return f"object_{posed.id}.html"


def write(folder: Path, objects: Sequence[PosedObject], least_confidence: float, *, several: bool) -> None:
    """Writes the files of :func:`names`; all are made before the first is written.

    ``several`` says whether poses are means of those of several models.
    """
    texts = {
        "poses.csv": as_csv(objects),
        "poses.json": json.dumps(as_json(objects), indent=1, allow_nan=False) + "\n",
        "index.html": _page(objects, least_confidence, several),
        **{_page_name(posed.listed): posed.page for posed in objects if posed.page is not None},
    }
    for name, text in texts.items():
        write_text(folder / name, text)


def as_csv(objects: Sequence[PosedObject]) -> str:
    """A line for each object, which :func:`nablahog.io.lists.read_objects` reads again."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, lineterminator="\n", restval="")
    writer.writeheader()
    for posed in objects:
        row: dict[str, Any] = {"image": posed.listed.image, "id": posed.listed.id, "error": posed.failure}
        row |= dict(zip(SIDES, posed.figures.get("box", posed.listed.box) or (), strict=False))
        if posed.figures:
            row |= {**_as_columns(posed.figures), "refused": posed.refused}
        writer.writerow(
            {name: guard_formula(value) if isinstance(value, str) else value for name, value in row.items()}
        )
    return out.getvalue()


def _as_columns(figures: Mapping[str, Any]) -> dict[str, Any]:
    """The figures of a pose by the columns of poses.csv."""
    position, second = (*figures["position"], *(figures["position_std"] or ())), figures["second"] or {}
    return {
        **{name: figures[name] for name in _PLAIN},
        "equivalent_azimuths": " ".join(map(str, figures["equivalent_azimuths"])),
        **{column: get_deviation(figures, name) for column, name in zip(_DEVIATIONS, _POSE, strict=True)},
        **dict(zip(POSITION, position, strict=False)),
        **dict(zip(PRINCIPAL_POINT, figures["principal_point"], strict=True)),
        **{column: second.get(column.removeprefix("second_")) for column in SECOND},
        **dict(zip(MATRIX, chain(*figures["matrix"][:3]), strict=True)),
    }


def as_json(objects: Sequence[PosedObject]) -> dict[str, Any]:
    """All figures, ready for JSON, in COCO's form: images, categories, which are models, and annotations."""
    found = [posed for posed in objects if posed.figures]
    images = {name: k for k, name in enumerate(dict.fromkeys(posed.listed.image for posed in objects), 1)}
    sizes = {posed.listed.image: (posed.figures["photograph_camera"] or posed.figures)["image_size"] for posed in found}
    models = {name: k for k, name in enumerate(sorted({posed.figures["model"] for posed in found}), 1)}
    annotations = []
    for posed in found:
        x0, y0, x1, y1 = posed.figures["box"]
        annotation = {
            "id": posed.listed.id,
            "image_id": images[posed.listed.image],
            "category_id": models[posed.figures["model"]],
            "bbox": [x0, y0, x1 - x0, y1 - y0],
            "area": (x1 - x0) * (y1 - y0),
            "iscrowd": 0,
            **{name: value for name, value in posed.figures.items() if name not in ("image_size", "box")},
            "refused": posed.refused,
        }
        annotations.append(annotation)
    return {
        "info": {"description": LEAD, "version": version("nablahog")},
        "images": [
            {"id": k, "file_name": name, **dict(zip(("height", "width"), sizes.get(name, ()), strict=False))}
            for name, k in images.items()
        ],
        "categories": [{"id": k, "name": name} for name, k in models.items()],
        "annotations": annotations,
        "failed": [
            {"id": posed.listed.id, "file_name": posed.listed.image, "error": posed.failure}
            for posed in objects
            if not posed.figures
        ],
        "definitions": DEFINITIONS,
    }


def rows(objects: Sequence[PosedObject]) -> list[dict[str, object]]:
    """The most important figures, for a table."""
    shown = ("model", "azimuth", "elevation", "theta", "distance", "similarity", "confidence", "second", "half_turn")
    return [{**_name(posed), **show_figures(posed.figures, shown)} for posed in objects]


def _name(posed: PosedObject) -> dict[str, object]:
    """The first columns of tables."""
    return {"image": posed.listed.image, "id": posed.listed.id}


def position_rows(objects: Sequence[PosedObject]) -> list[dict[str, object]]:
    """The positions of all objects whose camera is known, for a table."""
    shown = ((_name(posed), show_position(posed.figures)) for posed in objects)
    return [{**name, **position} for name, position in shown if position]


def _page(objects: Sequence[PosedObject], least_confidence: float, several: bool) -> str:
    panels = []
    for posed in objects[:SHOWN]:
        if posed.picture is not None:
            seen = (
                f"The object in gray, closer, and the photograph with its box; the outline of {posed.figures['model']}"
            )
            panels.append(Panel(posed.picture / 255, f"{posed.listed.image}, {posed.listed.id}", seen))
    doubtful = [
        {**_name(posed), "warning": posed.figures["warning"]} for posed in objects if posed.figures.get("warning")
    ]
    failed = [{**_name(posed), "error": posed.failure} for posed in objects if not posed.figures]
    outlines = (
        "Each object in gray, closer, and in its photograph, with its box in blue and the outline of the model that "
        f"fits best in red.{SEVERAL_MODELS if several else ''}"
        + ("" if len(objects) <= SHOWN else f" Only the first {SHOWN} are shown.")
    )
    sections = [
        html.Section("Outlines", outlines, panels, wide=True),
        html.Section("Positions", POSITIONS, table=position_rows(objects)),
        html.Section("Doubtful poses", "Poses that may be wrong, and why.", table=doubtful),
        html.Section("No pose", "Objects without a pose, and why.", table=failed),
    ]
    refused = sum(posed.refused for posed in objects)
    below = f"a confidence below {least_confidence:g}"
    lead = f"{LEAD} " + (f"{refused} of {len(objects)} have {below}." if refused else f"None has {below}.")
    table = [
        {**row, "image": html.Cell(row["image"], link="" if posed.page is None else _page_name(posed.listed))}
        for row, posed in zip(html.without_empty_columns(rows(objects)), objects, strict=True)
    ]
    return html.page(
        "Poses",
        f"{lead} {say_assumed([posed.figures for posed in objects])}".rstrip(),
        table,
        sections,
        define([*table[0]], [posed.figures for posed in objects]),
        html.footer("poses.json; poses.csv has most of them"),
    )
