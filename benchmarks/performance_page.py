"""The page of a record of measurements, as Markdown.

    python benchmarks/performance_page.py [docs/performance.json]

writes the page and its pictures anew, beside the record.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from goals import THEIR_OPENCV_MS, their_machine, verdicts
from page_growth import growth
from page_operator import limits, memory, operator
from page_searches import poses, preimages
from page_text import shape, table, times
from performance_plots import rates_of, write_plots
from programs import LIBRARIES
from timing import MOST_CALLS, TURN_MS

Record = Mapping[str, Any]
DOCS = Path(__file__).resolve().parent.parent / "docs"


def page(record: Record) -> str:
    rates = rates_of(record)
    sections = [
        "# Performance",
        *([_SMOKE] if record["quick"] else []),
        _how(record),
        "## Goals",
        _goals(record),
        "## The operator",
        *operator(record),
        "## Where others are faster",
        _losses(record),
        "## Memory",
        memory(record),
        "## How far from the limit",
        *limits(record, rates),
        "## Growth",
        *growth(record, rates),
        "## Pre-images",
        *preimages(record),
        "## Poses",
        *poses(record),
    ]
    return "\n\n".join(sections) + "\n"


_SMOKE = (
    "> **This is no measurement.** It is a smoke run (`--quick`), of tiny images with few repeats: it shows that the "
    "program runs and what its page looks like. Its numbers mean nothing."
)


def _how(record: Record) -> str:
    given = record["given"]
    absent = " and ".join(LIBRARIES[name] for name in LIBRARIES if name not in given)
    missing = f" {absent}: not measured, as no library was given." if absent else ""
    options = "".join(f" --{name} {'LIB' if name in LIBRARIES else 'DIR'}" for name in given)
    options += " --quick" if record["quick"] else ""
    machine = ", ".join(f"{name} {version}" for name, version in record["machine"].items())
    return f"""*Made by `python benchmarks/performance.py{options}` in {record["seconds"] / 60:.1f} minutes; all
numbers are in [performance.json](performance.json). {machine}.*

Every ratio compares two programs of the same run. Above 1 this package is faster; **bold** is a loss.

* Programs take turns on images of the same shape. In its turn a program first makes one call that is not counted,
  because the caches hold the data of another program. Then it makes as many calls as fit into {TURN_MS:g} ms, at most
  {MOST_CALLS}.
* A time is the median over the turns. A ratio is the median of the peer's time divided by ours in the same turn. The
  quartiles are in brackets.
* Times are CPU times on **one thread**, unless another number is given. For several threads the shortest wall time
  counts, because the others include waiting for a busy core.
* The **warm-up** is not counted: two calls of each program, or one if a call takes long and everything was compiled for
  smaller images. So nothing is compiled while times are measured.

The photograph is scikit-image's cameraman, gray, shrunk, or tiled for more than 512 pixels. Cells have 8 pixels.
Libraries get bytes, one image after the other; PyTorch's programs get float32 in 0…1, the whole batch.

* *Ours, X's* computes what X computes; *the paper's* is the paper's Dalal-type descriptor.
* *Naive torch* is the paper's descriptor in simple PyTorch (`benchmarks/peers.py`); *compiled torch* is the same with
  `torch.compile`.
* *With backward* is the descriptor and its derivative with respect to the image. No library has a derivative, so it is
  compared with their descriptors without one.{missing}"""


def _goals(record: Record) -> str:
    reached = {True: "yes", False: "**no**", None: "–"}
    rows = [[v.what, v.peer, v.goal, v.result, reached[v.met]] for v in verdicts(record)]
    text = table(["what", "compared with", "goal", "measured", "reached"], rows)
    factor = their_machine(record)
    if factor is None:
        return text
    return f"""{text}

Goals in seconds are for a machine on which OpenCV takes {THEIR_OPENCV_MS:g} ms for 512²; here it takes
{THEIR_OPENCV_MS / factor:.2f} ms. *There* is the time here, scaled by the ratio of the two; the goals are compared
with it."""


def _losses(record: Record) -> str:
    rows = [
        [name, peer, where, times(stats)]
        for where, programs in _measured(record)
        for name, row in programs.items()
        for peer, stats in row["ratios"].items()
        if stats["median"] < 1
    ]
    return table(["program", "slower than", "images", "times as fast"], rows) if rows else "Nowhere in this run."


def _measured(record: Record) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """All that has ratios, by where it was measured."""
    yield from ((shape(point), point["programs"]) for point in record["operator"])
    yield from ((f"{point['faces']} faces", point["programs"]) for point in record["faces"])
    for point in (p for p in record["models"] if "ratio" in p):
        yield f"{point['models']} models", {"ours, best": {"ratios": {"360 renderings of each": point["ratio"]}}}
    for what in ("preimages", "poses"):
        yield what, {f"ours, {name}": row for name, row in record[what]["rows"].items()}


def write_page(folder: Path) -> str:
    """Write the page of a folder's ``performance.json`` and its pictures beside it; returns the page."""
    record = json.loads((folder / "performance.json").read_text())
    write_plots(record, folder)
    text = page(record)
    up = os.path.relpath(DOCS, folder)  # links are written as of a page in docs/
    if up != ".":
        text = text.replace("](../", f"](../{up}/").replace("](poses.md", f"]({up}/poses.md")
    (folder / "performance.md").write_text(text)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("record", nargs="?", type=Path, default=DOCS / "performance.json")
    write_page(parser.parse_args().record.parent)


if __name__ == "__main__":
    main()
