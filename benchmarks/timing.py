"""Times of programs that take turns, memory of a call, and tables: what the benchmarks share.

All programs of one measurement run one after the other in each turn, so that they share whatever else the machine
does.  A ratio is of times of the same turn.  The first call of a turn is not counted: the caches hold the data of the
program before.
"""

from __future__ import annotations

import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from nablahog import native

Call: TypeAlias = Callable[[], Any]
Summary: TypeAlias = dict[str, float]

TURN_MS = 2.0  # of a program in a turn, at least: the clocks and a cold start count for less
MOST_CALLS = 50  # of a program in a turn


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
        """Make so many calls, and remember the mean time of one."""
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(calls):
            call()
        self.wall.append(1e3 * (time.perf_counter() - wall) / calls)
        self.cpu.append(1e3 * (time.process_time() - cpu) / calls)


def in_turns(calls: Mapping[str, Call], seconds: float, least: int = 3) -> dict[str, Times]:
    """Times of each program, in turns, for about ``seconds`` and at least ``least`` turns.

    Two calls of each are not counted: the first may compile, load and allocate.
    """
    counts = {}
    for name, call in calls.items():
        call()
        warm = Times()
        warm.add(call)
        counts[name] = max(1, min(MOST_CALLS, round(TURN_MS / max(warm.wall[0], 1e-3))))
    times = {name: Times() for name in calls}
    end, turns = time.perf_counter() + seconds, 0
    while turns < least or time.perf_counter() < end:
        for name, call in calls.items():
            call()
            times[name].add(call, counts[name])
        turns += 1
    return times


def summary(values: Sequence[float]) -> Summary:
    """The median and the quartiles."""
    low, median, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
    return {"median": median, "q1": low, "q3": high}


def ratio(peer: Sequence[float], ours: Sequence[float]) -> Summary:
    """How many times as fast ours is, turn by turn."""
    return summary([a / b for a, b in zip(peer, ours, strict=True)])


def cell(stats: Summary) -> str:
    """The median, and in brackets the quartiles."""
    return f"{digits(stats['median'])} ({digits(stats['q1'])}…{digits(stats['q3'])})"


def times_as_fast(stats: Summary) -> str:
    """A ratio, bold where the peer is the faster one."""
    text = f"{digits(stats['median'])}×"
    shown = f"**{text}**" if stats["median"] < 1 else text
    return f"{shown} ({digits(stats['q1'])}…{digits(stats['q3'])})"


def digits(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.3g}" if 1e-4 <= abs(value) < 1000 else f"{value:.0f}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """In Markdown; columns of figures are aligned to the right, all others to the left."""
    body = [list(row) for row in rows]
    figures = [all(re.match(r"[\d≥≤–*-]", cell) for cell in column) for column in zip(*body, strict=True)][1:]
    lines = [head, ["---", *("---:" if each else "---" for each in figures)], *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def raised_mib(call: Call) -> float:
    """By how much a call raises the peak of the resident set (VmHWM: Linux only).

    It should not be the first call of its process, which loads what is loaded on first use.
    """
    # imports peak higher than they end, and a new process even inherits the peak of its parent in ru_maxrss
    Path("/proc/self/clear_refs").write_text("5")
    before = resident_kib("VmHWM")
    call()
    return (resident_kib("VmHWM") - before) / 1024


def resident_kib(what: str) -> int:
    """VmHWM or VmRSS of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(what + ":"))


def printed_by(program: str, *arguments: str) -> float | None:
    """The number that a program prints in a process of its own; None if it fails, as on other systems than Linux."""
    done = subprocess.run([sys.executable, program, *arguments], capture_output=True, text=True, check=False)
    return float(done.stdout) if done.returncode == 0 else None


def processor() -> str:
    """The name of the processor and the width of its vectors."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    library = native.library()
    vectors = f"vectors of {8 * library.nablahog_vector_bytes()} bits" if library else "no compiled loops"
    return f"{next(names, platform.processor())}, {vectors}"
