"""How much longer is a call when other work has taken the caches since the last one?

    python benchmarks/cold_calls.py

Other work reads and writes more than the caches hold.  Of scikit-image's descriptor of one image, stored as bytes and
as floats, and of the least that PyTorch can do, which has the code of Python and PyTorch to load again, nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import torch

from machine import processor
from nablahog.hog import hog, presets
from page_text import table
from timing import Times, cell, ratio

SIDE = 512
LEAST = "one number + 1, PyTorch"
WORK = 40_000_000  # numbers of other work: 160 MB
TURNS = 60


def cold_calls(side: int = SIDE, turns: int = TURNS, work: int = WORK) -> dict[str, Any]:
    """Times of calls between other work, and of each repeated at once, on one thread."""
    spec, image, one, other = presets.skimage(), torch.rand(1, 1, side, side), torch.zeros(1), torch.zeros(work)
    calls: dict[str, Callable[[], object]] = {LEAST: partial(torch.add, one, 1)}
    for stored in ((255 * image).to(torch.uint8), image, image.double()):
        calls[str(stored.dtype).partition(".")[2]] = partial(hog, stored, spec)
    return {
        "machine": processor(),
        "side": side,
        "work": work,
        "calls": {name: _of(call, other, turns) for name, call in calls.items()},
    }


def _of(call: Callable[[], object], other: torch.Tensor, turns: int) -> dict[str, Any]:
    cold, warm = Times(), Times()
    call()
    for _ in range(turns):
        other.add_(1)
        cold.add(call)
        warm.add(call)
    return {"cold": cold.summaries(), "warm": warm.summaries(), "ratio": ratio(cold.wall, warm.wall)}


def page(record: dict[str, Any]) -> str:
    """The table, with what it shows."""
    rows = [
        [name, *(cell(stats) for stats in (row["warm"]["wall_ms"], row["cold"]["wall_ms"], row["ratio"]))]
        for name, row in record["calls"].items()
    ]
    side, mb = record["side"], 4 * record["work"] / 1e6
    return f"""Wall time of a call directly after another one (warm), and of a call after other work that has read and
written {mb:.0f} MB (cold): scikit-image's descriptor of one image of {side}², by its dtype. The first row is PyTorch's
smallest operation, for comparison ({record["machine"]}).

{table(["call", "ms, warm", "ms, cold", "cold / warm"], rows)}"""


def main() -> None:
    torch.set_num_threads(1)
    print(page(cold_calls()))


if __name__ == "__main__":
    main()
