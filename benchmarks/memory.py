"""By how much one call raises the peak of the resident set of a fresh process (Linux only: VmHWM)."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from timing import Call


def _kib(file: str, name: str) -> int:
    lines = Path(file).read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name + ":"))


def raised_mib(call: Call) -> float:
    """Of one call, which should not be the first of its process: that loads what is loaded on first use."""
    # imports peak higher than they end, and a new process even inherits the peak of its parent in ru_maxrss
    Path("/proc/self/clear_refs").write_text("5")
    before = _kib("/proc/self/status", "VmHWM")
    call()
    return (_kib("/proc/self/status", "VmHWM") - before) / 1024


def printed_by(program: str, arguments: Sequence[str]) -> float | None:
    """The number that a program prints in a process of its own; None where the system does not tell."""
    done = subprocess.run([sys.executable, program, *arguments], capture_output=True, text=True, check=False)
    return float(done.stdout) if done.returncode == 0 else None


def available_mib() -> float | None:
    """What is free for new programs; None where the system does not tell."""
    try:
        return _kib("/proc/meminfo", "MemAvailable") / 1024
    except OSError:
        return None
