"""What time is spent on: the parts of one call of the operator, and the files of the package that a search is in."""

from __future__ import annotations

import cProfile
import pstats
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import nablahog
from limits import Rates
from nablahog.hog import HOGSpec, hog
from nablahog.hog.descriptor import histograms
from programs import Photographs, forward, with_backward
from timing import Call, in_turns, summary

SMALL = 24  # pixels of the side of an image that is nothing but the call: three cells
LEAST_SHARE = 0.02  # of what is named
PASSED_ON = ("compile.py", "threads.py")  # files that only call what others gave them
_Function: TypeAlias = tuple[str, int, str]


def of_operator(spec: HOGSpec, side: int, seconds: float, rates: Rates) -> dict[str, float]:
    """CPU milliseconds of the parts of one call, medians of turns.

    Args:
        spec: the dialect.
        side: pixels.
        seconds: to spend.
        rates: of the machine, for the part of the angles alone.

    Returns:
        ``call``, ``call_both``: of an image of a few cells, without its derivative and with it; ``angles``: gradients,
        magnitudes and angles of so many pixels by the loop of :mod:`limits`; ``histograms``: up to the pooled votes;
        ``forward``, ``both``: the descriptor, without its derivative and with it.
    """
    describe = partial(partial, hog, spec=spec)
    small, large = Photographs(1, SMALL), Photographs(1, side)
    calls: dict[str, Call] = {
        "call": forward(describe, small),
        "call_both": with_backward(describe, small),
        "histograms": lambda: histograms(large.floats, spec),
        "forward": forward(describe, large),
        "both": with_backward(describe, large),
    }
    times = in_turns(calls, seconds)
    result = {name: summary(clocks.cpu)["median"] for name, clocks in times.items()}
    return result | {"angles": 1e3 * side**2 / rates.angles}


def of_search(call: Call) -> dict[str, float]:
    """Shares of the time of a call, by the files of the package that it is spent in, the largest first.

    What PyTorch and other packages take, and compiled loops, counts for the file that called them.
    """
    call()
    profile = cProfile.Profile()
    profile.runcall(call)
    stats: dict[_Function, Any] = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    package = Path(nablahog.__file__).parent
    seconds: dict[str, float] = {}
    for function, (_, _, own, _, _) in stats.items():
        for file, share in _callers(function, stats, package, ()).items():
            seconds[file] = seconds.get(file, 0.0) + own * share
    total = sum(seconds.values())
    shares = {file: value / total for file, value in sorted(seconds.items(), key=lambda item: -item[1])}
    named = {file: share for file, share in shares.items() if share >= LEAST_SHARE}
    return named | {"other": 1 - sum(named.values())}


def _callers(
    function: _Function, stats: dict[_Function, Any], package: Path, below: tuple[_Function, ...]
) -> dict[str, float]:
    """The files of the package that a function was called by, directly or not, each with its share of the calls."""
    file = Path(function[0])
    if file.is_relative_to(package) and file.name not in PASSED_ON:
        return {_part(file.relative_to(package)): 1.0}
    callers = {caller: times[3] for caller, times in stats[function][4].items() if caller not in (*below, function)}
    whole = sum(callers.values())
    result: dict[str, float] = {}
    for caller, cumulative in callers.items():
        share = cumulative / whole if whole else 1 / len(callers)
        for name, of_caller in _callers(caller, stats, package, (*below, function)).items():
            result[name] = result.get(name, 0.0) + share * of_caller
    return result or {"other": 1.0}


def _part(file: Path) -> str:
    """A file's name, or its folder's if that is a whole part to those who call it."""
    return file.parts[0] if file.parts[0] in ("hog", "render") else file.as_posix()
