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

import cold_calls
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
        "# How fast, beside others",
        *([_SMOKE] if record["quick"] else []),
        _how(record),
        "## Goals",
        _goals(record),
        "## The operator",
        *operator(record),
        "## Where others are faster",
        _losses(record),
        "## Between other work",
        cold_calls.page(record["cold"]),
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

Every ratio is of two programs of the same run. Above 1 this package is the faster one; **bold** is a loss.

* Programs of a shape take turns. In its turn each makes one call that is not counted, since the caches are full of what
  another program left. Then it makes as many as take {TURN_MS:g} ms, at most {MOST_CALLS}.
* A time is the median over the turns. A ratio is the median of the peer's time divided by ours in the same turn. The
  quartiles are in brackets.
* Times are those of the processor, on **one thread** unless another number is given. Of more threads the shortest wall
  time counts, since time spent waiting for a busy core says nothing.
* The **warm-up** is not counted: two calls of each program, or one where that takes long and all has been compiled for
  smaller images. So nothing is compiled while times are taken.

The photograph is scikit-image's cameraman, gray, shrunk, or beyond its 512 pixels tiled. Cells have 8 pixels. Libraries
are given bytes, one image after the other; PyTorch's programs are given float32 in 0…1, the whole batch.

* *Ours, X's* computes what X computes; *the paper's* is its Dalal-type descriptor.
* *Naive torch* is the paper's as one would write it (`benchmarks/peers.py`); *compiled torch* is that with
  `torch.compile`.
* *With backward* is the descriptor and the derivative by the image. No library has one, so it stands beside their
  descriptors alone.{missing}"""


def _goals(record: Record) -> str:
    reached = {True: "yes", False: "**no**", None: "–"}
    rows = [[v.what, v.peer, v.goal, v.result, reached[v.met]] for v in verdicts(record)]
    text = table(["what", "beside", "goal", "measured", "reached"], rows)
    factor = their_machine(record)
    if factor is None:
        return text
    return f"""{text}

Goals in seconds are for a machine on which OpenCV takes {THEIR_OPENCV_MS:g} ms for 512²; here it takes
{THEIR_OPENCV_MS / factor:.2f} ms. *There* is the time here times the ratio of the two, and is what is judged."""


def _losses(record: Record) -> str:
    rows = [
        [name, peer, where, times(stats)]
        for where, programs in _measured(record)
        for name, row in programs.items()
        for peer, stats in row["ratios"].items()
        if stats["median"] < 1
    ]
    return table(["program", "slower than", "at", "times as fast"], rows) if rows else "Nowhere in this run."


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
