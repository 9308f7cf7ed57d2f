"""The sections of the page on the operator: times, memory, limits and parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from limits import ANGLE, CHAIN, ENTRY, GRADIENT, HARD, KIB, LINEAR, SCATTER, Rates, limits_ms, work
from page_text import shape, table, times_each
from parts import SMALL
from programs import programs
from timing import cell, digits

Record = Mapping[str, Any]
SPECS = {p.name: (p.spec, p.backward) for p in programs({}) if p.spec is not None and p.where == "all"}


def operator(record: Record) -> list[str]:
    result = []
    for point in (p for p in record["operator"] if p["main"]):
        rows = [
            [name, cell(row["cpu_ms"]), cell(row["wall_ms"]), times_each(row["ratios"])]
            for name, row in point["programs"].items()
        ]
        result += [f"### {shape(point)}", table(["program", "CPU ms", "wall ms", "times as fast as"], rows)]
        result += left_out([point])
    return result


def left_out(points: Sequence[Mapping[str, Any]]) -> list[str]:
    """Which programs took no part, and why; nothing if all did."""
    reasons = [f"{name} at {shape(p)} ({reason})" for p in points for name, reason in p["left_out"].items()]
    return ["Left out: " + "; ".join(reasons) + "."] if reasons else []


def memory(record: Record) -> str:
    result = record["memory"]
    measured = {name: mib for name, mib in result["programs"].items() if mib is not None}
    if not measured:
        return "Not measured: this system does not report it."
    rows = [[name, f"{mib:.1f}", f"{mib / result['image_mib']:.2f}"] for name, mib in measured.items()]
    return f"""How much one call raises the peak of the resident set (VmHWM) of a fresh process, which holds one image
of {result["side"]}² and has described a small one. The descriptor is included. The last column counts images of
{result["image_mib"]:g} MiB, float32:

{table(["program", "MiB", "images"], rows)}"""


def limits(record: Record, rates: Rates) -> list[str]:
    sizes = [f"{size // KIB} KiB" if size < KIB**2 else f"{size // KIB**2} MiB" for size in rates.bandwidth]
    copied = table(["bytes moved", *sizes], [["GB/s", *(f"{rate / 1e9:.0f}" for rate in rates.bandwidth.values())]])
    done = {
        "multiply-add": rates.fused,
        "division": rates.divisions,
        "square root": rates.roots,
        "gradient, magnitude and angle of a pixel, by a compiled loop": rates.angles,
    }
    counted = table(["float32, in vectors", "10⁹ a second"], [[k, f"{v / 1e9:.1f}"] for k, v in done.items()])
    return [
        f"Rates of the machine, on one thread, the best of several repeats; bytes by copying.\n\n{copied}\n\n{counted}",
        _COUNTED,
        table(_HEAD, [row for p in record["operator"] if p["main"] for row in _of_limits(p, rates)]),
        _spent(record),
    ]


_HEAD = ["images", "program", "ms for its bytes", "ms for its operations", "measured", "times the limit"]
_COUNTED = f"""The limit is the least time that a descriptor needs ([`limits.py`](../benchmarks/limits.py)), the larger
of two times:

* Bytes: each byte of the image is read once, and each byte of the descriptor is written once. Backward reads the image
  again, reads the gradient with respect to the descriptor, and writes the gradient with respect to the image.
* Operations: for a pixel {GRADIENT} for the gradient, {ANGLE} for the angle, a division and a square root, {LINEAR} for
  two linear votes ({HARD} for a hard vote, without angle and division), one for each vote and row of cells, one for
  each bin and column of a row of cells, and {ENTRY} for each entry of the descriptor. Backward does all of this again,
  because nothing is stored, and {CHAIN + SCATTER} more. Additions, comparisons and selections count as multiply-adds.
  Divisions and roots are counted as simultaneous with these.

This is an estimate: a processor may also do additions and multiply-adds at the same time, and every program does more
than these operations."""


def _of_limits(point: Mapping[str, Any], rates: Rates) -> list[list[str]]:
    rows = []
    for name in (n for n in SPECS if n in point["programs"]):
        moved, done = limits_ms(work(*SPECS[name]), point["batch"] * point["side"] ** 2, rates)
        ms = point["programs"][name]["cpu_ms"]["median"]
        figures = [digits(moved), digits(done), digits(ms), f"{ms / max(moved, done):.1f}×"]
        rows.append([shape(point), name, *figures])
    return rows


def _spent(record: Record) -> str:
    rows = []
    for name, parts in record["parts"]["programs"].items():
        call, calls_back = parts["call"], max(0.0, parts["call_both"] - parts["call"])
        angles = parts["angles"] if SPECS[name][0].vote == "linear" else 0.0
        pooled = max(0.0, parts["histograms"] - call - angles)
        rest = max(0.0, parts["forward"] - parts["histograms"])
        back = parts["both"] - parts["forward"] - calls_back
        each = (call, angles, pooled, rest, calls_back, back)
        rows.append([name, digits(parts["both"]), *(f"{digits(ms)} ({100 * ms / parts['both']:.0f} %)" for ms in each)])
    parted = ["the call", "angles", "votes and pooling", "normaliser", "the call backward", "backward"]
    head = ["program", "with backward", *parted]
    return f"""The parts of the time, CPU ms at {record["parts"]["side"]}²:

* *the call*: the time for an image of {SMALL}², which is the same for any size: Python, and PyTorch's way to the loops;
* *angles*: the time of the loop of the table above for so many pixels, if votes are linear;
* *votes and pooling*: the rest of the time of the histograms;
* *normaliser*: the rest of the time of the descriptor, its layout included;
* *the call backward*: the time with backward less that without, for the small image;
* *backward*: the same for the large image, less *the call backward*.

{table(head, rows)}"""
