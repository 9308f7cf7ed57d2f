"""The sections of the page on pre-images and poses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from page_text import shares, table, times_each
from timing import cell

Record = Mapping[str, Any]
SEARCHES = {"best": "ours, best", "exhaustive": "360 renderings (`exhaustive`)", "paper": "the paper's (`paper`)"}


def preimages(record: Record) -> list[str]:
    result = record["preimages"]
    size = "×".join(map(str, result["size"]))
    rows = []
    for name, row in result["rows"].items():
        seconds = {key: value / 1000 for key, value in row["cpu_ms"].items()}
        label = f"ours, {name}" if row["ratios"] else name
        rows.append([label, cell(seconds), f"{row['cc']:.3f}", times_each(row["ratios"])])
    whole = []
    for name, row in result["whole"].items():
        figures = [f"{row['cpu_s']:.3f}", f"{row['wall_s']:.3f}", f"{row['cc']:.3f}", f"{row['evaluations']:.0f}"]
        whole.append([f"ours, {name}", *figures, f"{row['cpu_s'] / row['limit_s']:.0f}×"])
    head = ["all in one batch", "CPU s an image", "wall s", "CC", "evaluations", "times the limit"]
    return [
        f"""Photographs of {size}, {result["few"]} of them, one by one and in turns. *CNN-HOG* and *CNN-HOGb* have the
published schedule of 800 steps and their own network's descriptor; the others use UoCTTI. *paper* is the paper's own
search, `method="paper"`. CC is the mean correlation with the photographs.""",
        table(["method", "CPU s an image", "CC", "times as fast as"], rows),
        f"""All {result["images"]} photographs in one batch, as one would invert them:""",
        table(head, whole),
        f"""The limit is that of the operator with its derivative, times the number of evaluations. Parts of the time by
a profiler, which slows Python down, for {result["few"]} photographs in one batch:
{shares(result["shares"])}. Only `hog` is the operator. The rest is the search: the minimiser's vectors, the basis of
the unknowns, the objective with its priors, and undoing the normaliser.""",
    ]


def poses(record: Record) -> list[str]:
    result, rows = record["poses"], []
    for name, row in result["rows"].items():
        figures = [
            cell(row["cpu_s"]),
            f"{row['renderings']:.0f}",
            f"{row['error']:.2f}°",
            f"{100 * row['right']:.0f} %",
        ]
        of_limit = f"{row['cpu_s']['median'] / row['limit_s']:.0f}×"
        rows.append([SEARCHES[name], *figures, times_each(row["ratios"]), of_limit])
    head = ["search", "CPU s", "renderings", "median error", "within 15°", "times as fast as", "times the limit"]
    return [
        f"""{result["scenes"]} scenes of known models. The models were prepared before, and have {result["faces"]} faces
in the median. More measurements are in [poses.md](poses.md).""",
        table(head, rows),
        f"""The limit is that of as many renderings with their descriptors. Parts of the time by a profiler, for one
scene: {shares(result["shares"])}.""",
    ]
