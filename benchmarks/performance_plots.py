"""The pictures of the page: how times grow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from charts import Curve, chart
from goals import PAPERS
from limits import Rates, limits_ms, work
from programs import BACKWARD, NAIVE, PAPER

Record = Mapping[str, Any]
SHOWN = {  # of the operator, with their colours; peers as dashed rings
    PAPERS: 0,
    PAPERS + BACKWARD: 4,
    "ours, UoCTTI": 2,
    "OpenCV": 1,
    "scikit-image": 5,
    "VLFeat": 3,
    "dlib": 6,
    NAIVE: 7,
}


def write_plots(record: Record, folder: Path) -> None:
    """Write all pictures, ``performance-*.svg``."""
    plots: dict[str, Callable[[Record, Path], None]] = {
        "pixels": _pixels,
        "batch": _batch,
        "threads": _threads,
        "faces": _faces,
        "models": _models,
    }
    for name, plot in plots.items():
        plot(record, folder / f"performance-{name}.svg")


def of_axis(record: Record, axis: str) -> list[Any]:
    """The points of the operator along ``pixels``, one image each, or ``batch``, all of 128x128."""
    if axis == "pixels":
        return sorted((p for p in record["operator"] if p["batch"] == 1), key=lambda p: p["side"])
    side = min((p["side"] for p in record["operator"] if p["batch"] > 1), default=128)
    return sorted((p for p in record["operator"] if p["side"] == side), key=lambda p: p["batch"])


def rates_of(record: Record) -> Rates:
    stored = dict(record["limits"])
    bandwidth = {int(size): rate for size, rate in stored.pop("bandwidth").items()}
    return Rates(bandwidth=bandwidth, **stored)


def _curves(points: Sequence[Any], at: Callable[[Any], float], of: Callable[[Any, float], float]) -> list[Curve]:
    result = []
    for name, colour in SHOWN.items():
        there = [p for p in points if name in p["programs"]]
        values = [(at(p), of(p, p["programs"][name]["cpu_ms"]["median"])) for p in there]
        peer = not name.startswith("ours")
        result.append(Curve(name, values, colour, dashed=peer, ringed=peer))
    return result


def _pixels(record: Record, path: Path) -> None:
    points, rates = of_axis(record, "pixels"), rates_of(record)

    def nanoseconds(point: Any, ms: float) -> float:
        return float(1e6 * ms / point["side"] ** 2)

    curves = _curves(points, lambda p: p["side"], nanoseconds)
    for k, name in enumerate(("limit: its bytes", "limit: its operations")):
        values = [(p["side"], nanoseconds(p, limits_ms(work(PAPER, False), p["side"] ** 2, rates)[k])) for p in points]
        curves.append(Curve(f"{name}, the paper's", values, dashed=True))
    ticks = [(p["side"], str(p["side"])) for p in points]
    chart(path, "CPU ns a pixel, one thread", "pixels of a side, one image", ticks, curves)


def _batch(record: Record, path: Path) -> None:
    points = of_axis(record, "batch")
    curves = _curves(points, lambda p: p["batch"], lambda p, ms: 1e3 * ms / p["batch"])
    side, ticks = points[0]["side"], [(p["batch"], str(p["batch"])) for p in points]
    chart(path, f"CPU µs an image of {side}x{side}, one thread", "images of a batch", ticks, curves)


def _threads(record: Record, path: Path) -> None:
    curves, counts = [], ["1"]
    names = [name for name in SHOWN if name.startswith("ours") or name == NAIVE]
    for point in record["threads"]:
        for name in names:
            by_count = point["programs"].get(name, {})
            if not by_count:
                continue
            counts = list(by_count)
            values = [(int(count), by_count["1"]["min"] / by_count[count]["min"]) for count in counts]
            label = f"{name}, {point['batch']} of {point['side']}x{point['side']}"
            curves.append(Curve(label, values, SHOWN[name], dashed=point["batch"] > 1, ringed=name == NAIVE))
    ideal = [(int(count), float(count)) for count in counts]
    curves.append(Curve("as many times as threads", ideal, dashed=True))
    chart(
        path,
        "times as fast as on one thread, shortest wall times",
        "threads",
        [(x, f"{x:g}") for x, _ in ideal],
        curves,
    )


def _faces(record: Record, path: Path) -> None:
    points = record["faces"]
    names = list(points[0]["programs"])
    curves = [
        Curve(
            name,
            [(p["faces"], p["programs"][name]["cpu_ms"]["median"]) for p in points],
            k,
            dashed="opendr" in name,
            ringed="opendr" in name,
        )
        for k, name in enumerate(names)
    ]
    ticks = [(p["faces"], str(p["faces"])) for p in points]
    side = points[0]["side"]
    chart(path, f"CPU ms a rendering of {side}x{side}, one thread", "faces of the mesh", ticks, curves)


def _models(record: Record, path: Path) -> None:
    points, names = record["models"], {"best": "ours, best", "exhaustive": "360 renderings of each model"}
    curves = [
        Curve(
            label,
            [(p["models"], p[kind]["median"]) for p in points if kind in p],
            k,
            dashed=kind != "best",
            ringed=kind != "best",
        )
        for k, (kind, label) in enumerate(names.items())
    ]
    ticks = [(p["models"], str(p["models"])) for p in points]
    chart(path, "CPU s a pose, one thread", "models to choose among", ticks, curves)
