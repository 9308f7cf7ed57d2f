"""The section of the page on growth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from limits import Rates, limits_ms, rendering_work, work
from page_operator import SPECS, left_out
from page_text import shape, table, times, where_there
from performance_plots import of_axis
from programs import COMPILED
from timing import cell, digits

Record = Mapping[str, Any]
SAID = ("ours, the paper's", "ours, UoCTTI")  # of which the time of a pixel is said in words


def growth(record: Record, rates: Rates) -> list[str]:
    pixels, batch = of_axis(record, "pixels"), of_axis(record, "batch")
    return [
        "### Pixels",
        _picture("pixels"),
        _a_pixel((pixels[0], pixels[len(pixels) // 2], pixels[-1])),
        _operator(pixels, rates),
        *left_out(pixels),
        "### Batch",
        _picture("batch"),
        _a_pixel((batch[0], batch[-1])),
        _operator(batch, rates),
        *left_out(batch),
        "### Threads",
        _picture("threads"),
        _threads(record),
        "### Faces",
        _picture("faces"),
        _faces(record, rates),
        "### Models",
        _picture("models"),
        _models(record),
    ]


def _picture(what: str) -> str:
    return f"![Times by {what}](performance-{what}.svg)"


def _a_pixel(points: Sequence[Mapping[str, Any]]) -> str:
    said = []
    for name in SAID:
        there = [p for p in points if name in p["programs"]]
        ns = (1e6 * p["programs"][name]["cpu_ms"]["median"] / (p["batch"] * p["side"] ** 2) for p in there)
        each = ", ".join(f"{digits(one)} ns at {shape(p)}" for one, p in zip(ns, there, strict=True))
        said.append(f"{name.removeprefix('ours, ')}, {each}")
    return f"Time for a pixel: {'; '.join(said)}. Small images take more because of the call."


def _operator(points: Sequence[Mapping[str, Any]], rates: Rates) -> str:
    """Of each of our programs its time, its ratios, and how many times its limit it takes."""
    rows = []
    for name, (spec, backward) in SPECS.items():
        own = [p["programs"].get(name) for p in points]
        rows.append([f"{name}, ms", *(where_there(one, lambda row: digits(row["cpu_ms"]["median"])) for one in own)])
        peers = dict.fromkeys(peer for one in own if one for peer in one["ratios"] if not peer.startswith(COMPILED))
        for peer in peers:
            ratios = (one and one["ratios"].get(peer) for one in own)
            shown = (where_there(r, lambda stats: times(stats, False)) for r in ratios)
            rows.append([f"… times as fast as {peer}", *shown])
        rows.append(["… times its limit"])
        for point, one in zip(points, own, strict=True):
            limit = max(limits_ms(work(spec, backward), point["batch"] * point["side"] ** 2, rates))
            rows[-1].append("–" if one is None else f"{one['cpu_ms']['median'] / limit:.1f}×")
    return table(["", *map(shape, points)], rows)


def _threads(record: Record) -> str:
    counts = list(next(iter(record["threads"][0]["programs"].values())))
    rows = []
    for point in record["threads"]:
        for name, by_count in point["programs"].items():
            least = [by_count[count]["min"] for count in counts]
            rows.append([f"{name}, {shape(point)}", *(f"{digits(ms)} ({least[0] / ms:.2f}×)" for ms in least)])
    head = ["program", *("1 thread" if count == "1" else f"{count} threads" for count in counts)]
    return f"""Shortest wall ms, and in brackets the speed-up over one thread. The numbers of threads take turns;
programs are measured one after the other. The libraries have one thread. The limit is the number of threads; the call
and the work that one thread prepares are not shared.

{table(head, rows)}"""


def _faces(record: Record, rates: Rates) -> str:
    rows = []
    for point in record["faces"]:
        for name, row in point["programs"].items():
            derivative = name.endswith("derivative")
            needed = rendering_work(point["vertices"], point["faces"], point["side"] ** 2, derivative)
            limit = max(limits_ms(needed, 1, rates))
            ratios = ", ".join(times(stats) for stats in row["ratios"].values()) or "–"
            of_limit = f"{row['cpu_ms']['median'] / limit:.1f}×"
            rows.append([str(point["faces"]), name, cell(row["cpu_ms"]), ratios, of_limit])
    head = ["faces", "renderer", "CPU ms", "times as fast as opendr", "times the limit"]
    return f"""Renderings of {record["faces"][0]["side"]}², one sample a pixel, eight in a batch: `edges` is our
renderer, `opendr` the paper's; both are compiled. The limit is the time to read the mesh, to transform its
vertices and to write the image, and with derivative also its motion. The rest of the time is spent on finding visible
surfaces and edges.

{table(head, rows)}"""


def _models(record: Record) -> str:
    rows = []
    for point in record["models"]:
        ours, peer = point["best"], point.get("exhaustive")
        figures = [str(point["renderings"]["best"]), cell(ours), digits(1000 * ours["median"] / point["models"])]
        beside = [cell(peer), times(point["ratio"])] if peer else ["–", "–"]
        rows.append([str(point["models"]), *figures, *beside])
    head = ["models", "renderings", "CPU s", "ms a model", "360 renderings of each, CPU s", "times as fast"]
    return f"""The object's own model is not among the models. 360 renderings are left out if they take too long.

{table(head, rows)}"""
