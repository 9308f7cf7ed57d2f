"""What is measured on a GPU: times, bandwidth, memory; goals; and parts of which one may fail."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from timing import summary

SECONDS = 2.0  # of each program and size


def attempt(name: str, part: Callable[[], Any], report: dict[str, Any]) -> Any:
    """What a part returns; if it fails, None, its error printed and noted."""
    try:
        return part()
    except Exception as error:
        traceback.print_exc(file=sys.stdout)
        print(f"\nFAILED: {name}: {type(error).__name__}\n", flush=True)
        report["failed"].append(f"{name}: {type(error).__name__}: {error}"[:500])
        return None


def judge(what: str, value: float, goal: float, least: bool, report: dict[str, Any]) -> str:
    """Notes a goal, at least or at most so much, and says whether it is reached."""
    reached = bool(value >= goal if least else value <= goal)
    report["goals"].append({"what": what, "value": value, "goal": goal, "least": least, "reached": reached})
    return f"goal {'≥' if least else '≤'} {goal:g}: {'reached' if reached else 'MISSED'}"


def milliseconds(calls: dict[str, Callable[[], Any]]) -> dict[str, list[float]]:
    """Times of programs that take turns."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        for _ in range(3):
            call()
    torch.cuda.synchronize()
    end = time.perf_counter() + SECONDS * len(calls)
    while time.perf_counter() < end or min(map(len, times.values())) < 5:
        for name, call in calls.items():
            began, ended = (torch.cuda.Event(enable_timing=True) for _ in range(2))
            began.record()
            call()
            ended.record()
            ended.synchronize()
            times[name].append(began.elapsed_time(ended))
    return times


def copy_bandwidth() -> float:
    """Bytes a second that a copy reads and writes."""
    source = torch.empty(2**30, dtype=torch.uint8, device="cuda")
    target = torch.empty_like(source)
    times = milliseconds({"copy": lambda: target.copy_(source)})["copy"]
    return 2 * source.numel() / (1e-3 * summary(times)["median"])


def peak(call: Callable[[], Any], images: Tensor) -> float:
    """The most memory during a call beyond what there was before, in images."""
    call()
    torch.cuda.synchronize()
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated()
    result = call()
    torch.cuda.synchronize()
    del result
    return (torch.cuda.max_memory_allocated() - before) / images.nbytes
