"""How times grow: the operator's with pixels, batch and threads, a rendering's with faces, a pose's with models."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import torch

from memory import available_mib
from nablahog.paper.examples import Example
from nablahog.render.renderer import Method
from poses import estimate, objects
from programs import NAIVE, PAPER, UOCTTI, Photographs, Program
from render_speed import Case, calls, each, prepared, turned_chair
from timing import Call, Summary, Times, in_turns, ratio, summary, warmed

LONGEST_MS = 4000.0  # of a call; what would take longer is left out
COMPILED = 2**23  # pixels; what an image so large needs has been compiled for smaller ones
LEAST_TURNS = 5  # where only the shortest time of all counts
IN_A_ROW = 5  # calls on as many threads
RENDERERS: tuple[Method, ...] = ("edges", "opendr")
Point: TypeAlias = dict[str, Any]


class Shape(NamedTuple):
    """Images to be described.

    Attributes:
        batch, side: so many of so many pixels squared.
        of_tables: whether it is one of the first tables.
        of_compiled: whether programs take part that have to be compiled for it.
        seconds: to spend.
    """

    batch: int
    side: int
    of_tables: bool
    of_compiled: bool
    seconds: float


def operator(every: Sequence[Program], shapes: Sequence[Shape], bytes_a_pixel: Mapping[str, float]) -> list[Point]:
    """Times of all programs at each shape, growing.

    A program is left out where, by its time at the shape before and the pixels, a call would take too long, or by its
    memory at another shape would take half of what is free.

    Args:
        every: the programs.
        shapes: growing.
        bytes_a_pixel: of the programs whose memory is known.
    """
    points: list[Point] = []
    for batch, side, of_tables, of_compiled, seconds in shapes:
        pixels = batch * side**2
        kinds = ["all", *(["tables"] if of_tables else []), *(["compiled"] if of_compiled else [])]
        left_out = {p.name: reason for p in every if (reason := _too_much(p.name, pixels, points, bytes_a_pixel))}
        of = [p for p in every if p.name not in left_out and p.where in kinds]
        photographs = Photographs(batch, side)
        started = time.perf_counter()
        times = in_turns({p.name: p.make(photographs) for p in of}, seconds, again=pixels < COMPILED)
        result = {p.name: _beside(p, times) for p in of}
        points.append({"batch": batch, "side": side, "main": of_tables, "programs": result, "left_out": left_out})
        print(f"{batch} of {side}x{side}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
    return points


def _too_much(name: str, pixels: int, points: Sequence[Point], bytes_a_pixel: Mapping[str, float]) -> str | None:
    before = [p for p in points if name in p["programs"] or name in p["left_out"]]
    measured = [p for p in before if name in p["programs"]]
    if measured:
        last = measured[-1]
        ms = last["programs"][name]["cpu_ms"]["median"] * pixels / (last["batch"] * last["side"] ** 2)
        if ms > LONGEST_MS:
            return f"would take about {ms / 1000:.1f} s a call"
    free, wanted = available_mib(), bytes_a_pixel.get(name, 0.0) * pixels / 2**20
    if free is not None and wanted > free / 2:
        return f"would take about {wanted / 1024:.1f} GiB"
    return None


def _beside(program: Program, times: Mapping[str, Times]) -> dict[str, Any]:
    """Summaries of a program's times, and its ratios to the peers that took part."""
    own = times[program.name]
    ratios = {name: ratio(times[name].cpu, own.cpu) for name in program.beside if name in times}
    return {**own.summaries(), "ratios": ratios}


def threads(every: Sequence[Program], shapes: Sequence[tuple[int, int]], seconds: float) -> list[Point]:
    """Least wall times by the number of threads, of the programs that take more than one.

    Numbers of threads take turns, and programs come one after the other: a slow one would leave few turns to others.
    """
    counts = [1]
    while 2 * counts[-1] <= (os.cpu_count() or 1):
        counts.append(2 * counts[-1])
    of = [p for p in every if p.name.startswith(NAIVE) or (p.spec in (PAPER, UOCTTI) and p.where == "all")]
    points = []
    for batch, side in shapes:
        photographs = Photographs(batch, side)
        result = {p.name: _by_threads(p.make(photographs), counts, seconds) for p in of}
        points.append({"batch": batch, "side": side, "programs": result})
    return points


def _by_threads(call: Call, counts: Sequence[int], seconds: float) -> dict[str, Summary]:
    times = {count: Times() for count in counts}
    for count in counts:
        torch.set_num_threads(count)
        warmed(call)
    end, turns = time.perf_counter() + seconds, 0
    while turns < LEAST_TURNS or time.perf_counter() < end:
        turns += 1
        for count in counts:
            torch.set_num_threads(count)
            call()  # which wakes a processor that had nothing to do
            for _ in range(IN_A_ROW):
                times[count].add(call)
    torch.set_num_threads(1)
    return {str(count): summary(of.wall) for count, of in times.items()}


def faces(counts: Sequence[int], side: int, seconds: float) -> list[Point]:
    """Milliseconds a rendering, one sample a pixel, one thread, of our renderer and of the paper's."""
    points = []
    for count in counts:
        mesh, case = turned_chair(count), Case(count, side, 1, 1)
        renderers = {method: prepared(mesh, case, method) for method in RENDERERS}
        made = {f"{method}, {what}": call for method, r in renderers.items() for what, call in calls(r).items()}
        times = {name: each(batch) for name, batch in in_turns(made, seconds).items()}
        result: dict[str, Point] = {name: {**clocks.summaries(), "ratios": {}} for name, clocks in times.items()}
        for what in ("forward", "with derivative"):
            peer = f"opendr, {what}"
            result[f"edges, {what}"]["ratios"] = {peer: ratio(times[peer].cpu, times[f"edges, {what}"].cpu)}
        points.append({"faces": len(mesh.faces), "vertices": len(mesh.vertices), "side": side, "programs": result})
    return points


def models(folder: Path | None, most: int, scenes: int) -> list[Point]:
    """Seconds to find a pose among 1, 2, 4, … models, none the object's own, by us and by 360 renderings of each.

    Every search has prepared its models before.
    """
    examples = objects(scenes, folder, unknown_model=True)
    common = [model for model in examples[0].models if all(model in example.models for example in examples)]
    points: list[Point] = []
    count, kinds = 1, ["best", "exhaustive"]
    while count <= min(most, len(common)):
        some = [replace(example, models=tuple(common[:count])) for example in examples]
        result = {kind: estimate(some[0], {"method": kind}) for kind in kinds}
        spent: dict[str, list[float]] = {kind: [] for kind in kinds}
        for example in some:
            for kind in kinds:
                spent[kind].append(seconds_of(example, kind))
        point: Point = {"models": count, "renderings": {kind: one.renderings for kind, one in result.items()}}
        point |= {kind: summary(values) for kind, values in spent.items()}
        if "exhaustive" in spent:
            point["ratio"] = ratio(spent["exhaustive"], spent["best"])
            if 2 * point["exhaustive"]["median"] > LONGEST_MS / 1000:
                kinds = ["best"]
        points.append(point)
        count *= 2
    return points


def seconds_of(example: Example, method: str) -> float:
    """CPU time of a search."""
    clock = Times()
    clock.add(lambda: estimate(example, {"method": method}))
    return clock.cpu[0] / 1000
