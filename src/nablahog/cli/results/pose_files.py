"""The figures of poses, and what they mean; poses of objects as files: CSV, JSON like COCO's, and a page."""

from __future__ import annotations

import csv
import io
import json
import math
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
from .pose_pictures import split_pictures

LEAST_SHOWN = 0.001  # probability of a half turn: confidences are not measured finely enough for less
SHOWN = 100  # objects with pictures on the page
LEAD = "The poses at which renderings of CAD models have the HOG most like that of objects in photographs."
_POSE = ("azimuth", "elevation", "theta", "distance", "distance_in_file_units", "x", "y")
_CAMERA = ("focal_length", "focal_length_from")
_HEADINGS = {"distance": "distance,\ndiagonals"}  # of columns, where they say the unit
POSITIONS = (
    "The middle of each model's bounding box along the camera's axes: x right, y down, z forward; of objects whose "
    "camera is known. If the model's file is in millimetres, so are these."
)

DEFINITIONS = {
    "model": "The model that fits best, of all candidates. Without --mesh they are those of nablahog.sample_chairs().",
    "azimuth": "Of the camera around the object's vertical axis, in degrees: 0 sees the front, 90 the object's left "
    "side.",
    "elevation": "Of the camera above the object's horizon, in degrees.",
    "theta": "Counter-clockwise rotation of the picture, in degrees.",
    "distance": "From the camera to the middle of the object, in diagonals of its bounding box. It "
    "depends on the focal length, which is hard to tell from one photograph.",
    "distance_in_file_units": "The same in the units of the model's file.",
    "x, y": "Pixels to the right and down from the middle of the photograph to the middle of the object.",
    "standard_deviations": "What follows ±: of 100 poses that are right (the confidence says how likely that is), 68 "
    "have the true value within one of them. Of a single model only. The distance has none where the focal length is "
    "assumed.",
    "covariance": "6x6, of azimuth, elevation, distance, theta, x and y in their units, in this order; null where it "
    "is infinite.",
    "position, position_std": "Of the middle of the model's bounding box along the camera's axes (x right, y down, z "
    "forward), in the units of the model's file, and its standard deviations.",
    "focal_length": "Of the camera of the pose, in pixels of the photograph.",
    "focal_length_from": "given: by an option; exif: by the photograph's file; assumed: an object that fills its "
    "box is taken to be 3 of its diagonals away, so distances are not the true ones.",
    "photograph_camera": "The camera that took the photograph, with its distortion, as the options say it; null if it "
    "distorts nothing and its pixels are square. Otherwise poses are for the ideal camera in its place: x, y, "
    "focal_length, principal_point and intrinsics belong to the undistorted photograph, image_size pixels high and "
    "wide; box and bbox to the photograph as it is; matrix to both.",
    "matrix, intrinsics": "A point X of the model's file, (x, y, z, 1), is seen at intrinsics (3x3) times the upper "
    "three rows of matrix (4x4) times X, divided by the last coordinate: OpenCV's convention. If the focal length "
    "is assumed, the principal point is that of a camera that looks straight at the object.",
    "matrix_world": "From the camera's frame (OpenGL's: y up, it looks along -z) to a world with z up, in which the "
    "model is as Blender imports its file: Blender's matrix_world of the camera.",
    "similarity": "calibrated: the score of the rendering's linear discriminant on the window of the photograph, in "
    "standard deviations over arbitrary photographs; patches: the sum over the photograph's visual elements of the dot "
    "products of the ∇HOG descriptors of their patches with those of the rendering, as in the paper.",
    "confidence": "The probability that the rotation is within 15° of the true one, or of one from which the model "
    "looks the same, as measured on rendered scenes and photographs.",
    "half_turn": "The probability that the object is seen from the opposite side: front and back may look alike.",
    "second": "The second answer: azimuth and elevation of the runner-up that is most probably right, with its "
    "confidence, if this is above 0.15.",
    "runners_up": "The best poses from other sides; share: of the best pose's similarity, or of its side's votes; "
    "confidence: the probability that it is the right one.",
    "renderings": "The number of renderings that the search compared, of all candidates.",
    "seconds": "Wall time of the search; the first in a process takes longer, because code is loaded.",
}
"""What the figures mean."""


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
        page, confidence = figures.pop("page", None), figures["confidence"]
        refused = confidence is not None and confidence < least_confidence
        return cls(listed, figures, result.pictures[0], page, refused=refused)


def names(objects: Sequence[AnnotatedObject], pages: bool) -> list[str]:
    """The names of the files that :func:`write` leaves."""
    return ["poses.csv", "poses.json", "index.html", *(_page_name(posed) for posed in objects if pages)]


def _page_name(posed: AnnotatedObject) -> str:
    return f"object_{posed.id}.html"


def write(folder: Path, objects: Sequence[PosedObject], least_confidence: float) -> None:
    """Writes the files of :func:`names`; all are made before the first is written."""
    texts = {
        "poses.csv": as_csv(objects),
        "poses.json": json.dumps(as_json(objects), indent=1, allow_nan=False) + "\n",
        "index.html": _page(objects, least_confidence),
        **{_page_name(posed.listed): posed.page for posed in objects if posed.page is not None},
    }
    for name, text in texts.items():
        write_text(folder / name, text)


def as_csv(objects: Sequence[PosedObject]) -> str:
    """A line for each object, which :func:`nablahog.io.lists.read_objects` reads again.

    m00 … m23 are the upper three rows of the matrix, row by row.
    """
    out = io.StringIO()
    figures = ("model", *_POSE, *_CAMERA, "similarity", "confidence")
    matrix = [f"m{row}{col}" for row in range(3) for col in range(4)]
    deviations = [f"{name}_std" for name in _POSE]
    position = [f"position_{axis}{suffix}" for suffix in ("", "_std") for axis in "xyz"]
    columns = ["image", "id", *SIDES, *figures, *deviations, *position, "refused", *matrix, "error"]
    writer = csv.DictWriter(out, columns, lineterminator="\n", restval="")
    writer.writeheader()
    for posed in objects:
        row: dict[str, Any] = {"image": posed.listed.image, "id": posed.listed.id, "error": posed.failure}
        row |= dict(zip(SIDES, posed.figures.get("box", posed.listed.box) or (), strict=False))
        if posed.figures:
            row |= {name: posed.figures[name] for name in figures}
            row |= {f"{name}_std": _deviation(posed.figures, name) for name in _POSE}
            row |= dict(
                zip(position, chain(posed.figures["position"], posed.figures["position_std"] or ()), strict=False)
            )
            row |= dict(zip(matrix, chain(*posed.figures["matrix"][:3]), strict=True))
            row["refused"] = posed.refused
        writer.writerow(
            {name: guard_formula(value) if isinstance(value, str) else value for name, value in row.items()}
        )
    return out.getvalue()


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
    return [
        {
            "image": posed.listed.image,
            "object": posed.listed.id,
            **show_figures(posed.figures, shown),
        }
        for posed in objects
    ]


def position_rows(objects: Sequence[PosedObject]) -> list[dict[str, object]]:
    """The positions of all objects whose camera is known, for a table."""
    named = (({"image": one.listed.image, "object": one.listed.id}, show_position(one.figures)) for one in objects)
    return [{**name, **position} for name, position in named if position]


def show_position(figures: Mapping[str, Any]) -> dict[str, object]:
    """The position of an object in the units of the model's file, as a row of a table; empty without a known camera."""
    if figures.get("focal_length_from", "assumed") == "assumed":
        return {}
    deviations = figures["position_std"] or (None,) * 3
    return {
        f"{axis}, units of\nthe model's file": _with_deviation(value, deviation)
        for axis, value, deviation in zip("xyz", figures["position"], deviations, strict=True)
    }


def define(names: Sequence[str], figures: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The definitions of the columns of a table of poses, and of standard deviations if there are any."""
    deviations = ["standard_deviations"] if any(pose.get("standard_deviations") for pose in figures) else []
    defined = {*(name.split(",\n")[0] for name in names), *deviations}
    return {name: text for name, text in DEFINITIONS.items() if defined & {name, *name.split(", ")}}


def show_figures(figures: Mapping[str, Any], names: Sequence[str]) -> dict[str, object]:
    """Some figures of a pose for a table, with ± and the standard deviation where there is one."""
    shown = {name: _with_deviation(figures.get(name), _deviation(figures, name)) for name in names}
    if figures.get("any_azimuth"):
        shown["azimuth"] = "any"
    if "second" in shown:
        shown["second"] = _say_second(figures.get("second"))
    half_turn = figures.get("half_turn")
    if "half_turn" in shown and half_turn is not None and half_turn < LEAST_SHOWN:
        shown["half_turn"] = html.Shown(half_turn, f"< {LEAST_SHOWN:g}")
    return {_HEADINGS.get(name, name): value for name, value in shown.items()}


def _say_second(rival: Mapping[str, Any] | None) -> str | None:
    """The viewpoint of the second answer, with its confidence."""
    if rival is None:
        return None
    return f"{rival['azimuth']:.0f}°, {rival['elevation']:.0f}° ({rival['confidence']:.2f})"


def _deviation(figures: Mapping[str, Any], name: str) -> float | None:
    return (figures.get("standard_deviations") or {}).get(name)


def _with_deviation(value: Any, deviation: float | None) -> object:
    """A figure to the decimals that its standard deviation has with two digits, at most four."""
    if deviation is None:
        return value
    decimals = min(max(1 - math.floor(math.log10(deviation)), 0), 4) if deviation > 0 else 4
    return html.Shown(value, f"{value:.{decimals}f} ± {deviation:.{decimals}f}")


def _page(objects: Sequence[PosedObject], least_confidence: float) -> str:
    panels = []
    for posed in objects[:SHOWN]:
        if posed.picture is not None:
            name, model = f"{posed.listed.image}, {posed.listed.id}", posed.figures["model"]
            photograph, close = split_pictures(posed.picture / 255, posed.figures["image_size"])
            panels.append(Panel(photograph, name, f"The photograph with the object's box and the outline of {model}"))
            panels.append(Panel(close, f"{name}, closer", f"The object in gray with the outline of {model}"))
    doubtful = [
        {"image": posed.listed.image, "object": posed.listed.id, "why": posed.figures["warning"]}
        for posed in objects
        if posed.figures.get("warning")
    ]
    failed = [
        {"image": posed.listed.image, "object": posed.listed.id, "why": posed.failure}
        for posed in objects
        if not posed.figures
    ]
    first = "" if len(objects) <= SHOWN else f" Only the first {SHOWN} are shown."
    sections = [
        html.Section("Outlines", f"Objects with the outline of the model that fits best, and closer.{first}", panels),
        html.Section("Positions", POSITIONS, table=position_rows(objects)),
        html.Section("Doubtful poses", "Poses that are more likely wrong than right, and why.", table=doubtful),
        html.Section("No pose", "Objects without a pose, and why.", table=failed),
    ]
    refused = sum(posed.refused for posed in objects)
    below = f"a confidence below {least_confidence:g}"
    lead = f"{LEAD} " + (f"{refused} of {len(objects)} have {below}." if refused else f"None has {below}.")
    definitions = define([*rows(objects[:1])[0]], [posed.figures for posed in objects])
    return html.page("Poses", lead, rows(objects), sections, definitions, html.footer("poses.json and poses.csv"))
