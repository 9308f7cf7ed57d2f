"""The machine that measures."""

from __future__ import annotations

import platform
from pathlib import Path


def processor() -> str:
    """Its name; where the system does not tell, that of its kind."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())
