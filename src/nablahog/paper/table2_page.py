"""Table 2 on the terminal and as a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ..metrics import VIEW_COUNTS
from ..viz import html
from ..viz.pictures import Panel, outlined
from ..viz.similarity_plot import draw_boxes
from .annotations import Example
from .examples import CONDITIONS
from .pose_methods import POSE_METHODS, Table2Settings
from .table2 import CRITERIA, NO_POSE, WITHIN, Table2, Table2Row
from .tables import RESAMPLES, Statistics, cell, count_failures, failures_section

LEAD = (
    "In each image the pose of one object was estimated from the similarity of its HOG descriptors to those of "
    "renderings of CAD models. The figures are percentages of objects whose azimuth is right, beside those of "
    "Table 2 of See the Difference (ICCV 2015)."
)

DEFINITIONS = {
    "4, 8, 16, 24 views: by interval": "The azimuth is right if it is in the same one of that many equal intervals as "
    "the true one; the first has 0° in its middle, as in the code published with PASCAL3D+.",
    f"{', '.join(f'< {360 / views:g}°' for views in VIEW_COUNTS)}: by threshold": "The azimuth is right if it "
    "differs from the true one by less.",
    "median error, error": "Half of the azimuths are off by at most this, measured the shorter way round.",
    "rotation, rotation error": "The angle of the rotation from the true viewpoint (azimuth, elevation and in-plane "
    "rotation) to the estimated one (Tulsiani and Malik, CVPR 2015): the share within π/6 = 30° and π/18 = 10°, "
    "and the median.",
    "objects": f"All count: an object without a pose counts as wrong, by {NO_POSE:g}°.",
    "interval below a figure": f"The 95 % interval: percentile bootstrap, {RESAMPLES:,} resamples of the objects with "
    "a fixed seed. Of a few objects it is too narrow.",
    f"{', '.join(map(str, VIEW_COUNTS))} views, paper": "What the paper prints, for 247 chairs of PASCAL VOC and 1393 "
    "CAD models. It names no criterion. Only by interval does its baseline beat "
    "chance at 4 views, so we compare by interval.",
    "seconds": "Median wall time of a method for one object, in a process of one thread that has read the models. The "
    "first object of a process takes longer, because code is loaded.",
    "condition, method, figure, value": "In summary.csv: a row of a table, the name of a figure, and its value.",
    ", ".join(f"{criterion}_{views}" for criterion in CRITERIA for views in VIEW_COUNTS): "In summary.csv: the figures "
    "by interval and by threshold, in percent.",
    ", ".join(["median_error", "rotation_median_error", *(f"rotation_within_{angle:g}_degrees" for angle in WITHIN)]): (
        "In summary.csv: the median errors of azimuths and of rotations, in degrees, and the shares of rotations."
    ),
    "low, high": "In summary.csv: the ends of the interval.",
    "object, model, true_azimuth, true_elevation, true_theta": "In per_object.csv: an object, its model, and its true "
    "viewpoint, in degrees.",
    "azimuth, elevation, theta, distance, found_model": "In per_object.csv: the pose that a method found, in degrees "
    "and, for the distance, diagonals of the model; and the model that it found.",
    "rotation_error": "In per_object.csv: the angle of the rotation.",
    "reason": "In failures.csv: why a method has no pose of an object.",
    **{name: method.about for name, method in POSE_METHODS.items()},
}
"""What each figure, and each method, means, printed under the table."""


def terminal_rows(table: Table2) -> list[dict[str, object]]:
    """The accuracies of azimuths by interval, the paper's in brackets, and by threshold, one mapping for each row."""
    rows = []
    for line in table.table_rows():
        row: dict[str, object] = {"method": line.method}
        for views in VIEW_COUNTS:
            paper = line.paper.get(views)
            figure = html.figure(_percent(line.accuracy["interval", views]))
            row[f"{views} views"] = figure if paper is None else f"{figure} ({paper:.1f})"
            row[f"< {360 / views:g}°"] = _percent(line.accuracy["threshold", views])
        rows.append({**row, "error, °": line.error.median})
    return rows


def terminal_rotations(table: Table2) -> list[dict[str, object]]:
    """Accuracies of whole rotations, and times, one mapping for each row."""
    return [
        {
            "method": line.method,
            "objects": line.rotation.n,
            **{f"rotation ≤ {angle:g}°": _percent(line.within[angle]) for angle in WITHIN},
            "rotation error, °": line.rotation.median,
            "seconds": line.seconds,
        }
        for line in table.table_rows()
    ]


def terminal_conditions(table: Table2) -> list[dict[str, object]]:
    """Accuracies and errors under harder conditions, one mapping for each row."""
    return [
        {**_under(name, line, _percent), "error, °": line.error.median}
        for name in table.conditions
        for line in table.under(name).table_rows()
    ]


def _under(condition: str, line: Table2Row, shown: Callable[[Statistics], object]) -> dict[str, object]:
    """Figures of a method under a condition for the terminal and the page; ``shown`` makes the cell of an accuracy."""
    return {
        "condition": condition,
        "method": line.method,
        "objects": line.error.n,
        **{f"{views} views": shown(line.accuracy["interval", views]) for views in VIEW_COUNTS},
        f"< {360 / VIEW_COUNTS[-1]:g}°": shown(line.accuracy["threshold", VIEW_COUNTS[-1]]),
    }


def _percent(summary: Statistics) -> html.Shown | None:
    return None if summary.mean is None else html.Shown(summary.mean, f"{summary.mean:.1f}")


def page(table: Table2, settings: Table2Settings) -> str:
    lines = table.table_rows()
    text = "A method that failed counts as wrong above. A further run with the same settings tries it again."
    failures = failures_section(table.failures, "object", text)
    return html.page(
        "Table 2: poses from HOG descriptors",
        f"{LEAD} {table.examples.origin}{count_failures(table.failures)}",
        [_row(line) for line in lines],
        [failures, _rotations(lines), *_conditions(table), _pictures(table)],
        {**DEFINITIONS, **{name: CONDITIONS[name].about for name in table.conditions}},
        html.footer("summary.csv and per_object.csv beside this page", f", seed {settings.seed}"),
    )


def _row(line: Table2Row) -> Mapping[str, object]:
    row: dict[str, object] = {"method": line.method, "objects": line.error.n}
    for views in VIEW_COUNTS:
        row[f"{views} views"] = _cell(line.accuracy["interval", views])
        row[f"{views}\xa0views\npaper"] = line.paper.get(views)
        row[f"< {360 / views:g}°"] = _cell(line.accuracy["threshold", views])
    return {**row, "median error, °": cell(line.error, line.error.median), "seconds": line.seconds}


def _cell(summary: Statistics) -> html.Cell | None:
    if summary.low is None or summary.high is None:
        return None
    return html.Cell(_percent(summary), f"{summary.low:.1f} … {summary.high:.1f}")


def _rotations(lines: Sequence[Table2Row]) -> html.Section:
    rows = [
        {
            "method": line.method,
            **{f"≤ {angle:g}°, %": _cell(line.within[angle]) for angle in WITHIN},
            "median error, °": cell(line.rotation, line.rotation.median),
        }
        for line in lines
    ]
    text = "How far the whole viewpoints are off: azimuth, elevation and in-plane rotation together."
    return html.Section("Rotation", text, table=rows)


def _conditions(table: Table2) -> list[html.Section]:
    """The second table, and what an object is like in each of its conditions."""
    rows: list[Mapping[str, object]] = []
    for name in table.conditions:
        for line in table.under(name).table_rows():
            row = _under(name, line, _cell)
            row[f"rotation ≤ {WITHIN[0]:g}°, %"] = _cell(line.within[WITHIN[0]])
            rows.append({**row, "median error, °": cell(line.error, line.error.median), "seconds": line.seconds})
    text = (
        "Fewer objects of the same kind, under conditions that are described at the end. Scenes have exact boxes "
        "unless the condition changes them. The measures are those of the first table."
    )
    panels = []
    for name, examples in table.conditions.items():
        first = examples.objects[0]
        picture = first.image if first.box is None else draw_boxes(first.image, [first.box])
        panels.append(Panel(picture, name, f"The image {first.name} with the box that methods are given"))
    first_of_each = html.Section("", "The first object of each condition.", panels)
    return [html.Section("Harder conditions", text, table=rows), first_of_each]


def _pictures(table: Table2) -> html.Section:
    """As in the paper: the images side by side, and each method's pose below them."""
    names = {name for summary in table.pictures.values() for name in summary}
    shown = [example for example in table.examples.objects if example.name in names]
    images = {
        example.name: html.Cell(
            Panel(example.image, example.name, f"The image {example.name}"), f"azimuth {example.azimuth:.0f}°"
        )
        for example in shown
    }
    rows = [
        {"method": method.name, **{example.name: _pose(table, method.name, example) for example in shown}}
        for method in table.methods
    ]
    text = "The outline of the model at the pose that each method found, and how far its azimuth is off."
    return html.Section("Pictures", text, table=[{"method": "test images", **images}, *rows] if shown else [])


def _pose(table: Table2, method: str, example: Example) -> html.Cell | None:
    pose, silhouette = table.figures[method].get(example.name), table.pictures[method].get(example.name)
    if pose is None or silhouette is None:
        return None
    off = round((pose["azimuth"] - example.azimuth + 180) % 360 - 180)
    remark = f"{off:+d}°" if pose["model"] == example.model else f"{off:+d}°\n{pose['model']}"
    seen = f"{example.name} with the outline of a model at the pose that {method} found"
    return html.Cell(Panel(outlined(example.image, silhouette >= 128), f"{example.name}, {method}", seen), remark)
