"""Times of programs that take turns, and what is said of them.

All programs of one measurement run one after the other in each turn, so that they share whatever else the machine does,
and a ratio is of times of the same turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

Call: TypeAlias = Callable[[], Any]
Summary: TypeAlias = dict[str, float]

TURN_MS = 2.0  # of a program in a turn, at least: the clocks and a cold start count for less
MOST_CALLS = 50  # of a program in a turn
SETTLED_MS = 250.0  # a first call that took longer hardly gets faster by a second one, unless it has compiled


@dataclass
class Times:
    """Milliseconds a call, one number a turn.

    Attributes:
        wall: by the clock on the wall.
        cpu: of the process, over all its threads.
    """

    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    def add(self, call: Call, calls: int = 1) -> None:
        """Make so many calls, and remember what one takes in the mean."""
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(calls):
            call()
        self.wall.append(1e3 * (time.perf_counter() - wall) / calls)
        self.cpu.append(1e3 * (time.process_time() - cpu) / calls)

    def summaries(self) -> dict[str, Summary]:
        return {"wall_ms": summary(self.wall), "cpu_ms": summary(self.cpu)}


def warmed(call: Call, again: bool = True) -> int:
    """Make the calls that are not counted; returns how many calls a turn should make.

    Args:
        call: allocates, and compiles or loads what it needs, in its first call.
        again: whether the first call is likely to do so; if not, it is the only one where it takes long.
    """
    first, second = Times(), Times()
    first.add(call)
    if first.wall[0] > SETTLED_MS and not again:
        return 1
    second.add(call)
    return max(1, min(MOST_CALLS, round(TURN_MS / max(second.wall[0], 1e-3))))


def in_turns(calls: Mapping[str, Call], seconds: float, least: int = 3, again: bool = True) -> dict[str, Times]:
    """Times of each program, in turns, for about ``seconds`` and ``least`` turns or more; see :func:`warmed`."""
    counts = {name: warmed(call, again) for name, call in calls.items()}
    times = {name: Times() for name in calls}
    end = time.perf_counter() + seconds
    turns = 0
    while turns < least or time.perf_counter() < end:
        for name, call in calls.items():
            times[name].add(call, counts[name])
        turns += 1
    return times


def summary(values: Sequence[float]) -> Summary:
    """The median with its spread, and how many values there are."""
    low, median, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
    return {"median": median, "q1": low, "q3": high, "min": min(values), "max": max(values), "count": len(values)}


def ratio(peer: Sequence[float], ours: Sequence[float]) -> Summary:
    """How many times as fast ours is, turn by turn."""
    return summary([a / b for a, b in zip(peer, ours, strict=True)])


def cell(stats: Summary) -> str:
    """The median, and in brackets the quartiles."""
    return f"{digits(stats['median'])} ({digits(stats['q1'])}…{digits(stats['q3'])})"


def digits(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.3g}" if 1e-4 <= abs(value) < 1000 else f"{value:.0f}"
