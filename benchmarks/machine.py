"""The machine that measures."""

from __future__ import annotations

import platform
from pathlib import Path

from nablahog import native


def processor() -> str:
    """Its name and the width of its vectors; where the system does not tell, that of its kind."""
    library = native.library()
    return f"{_name()}, {f'vectors of {8 * library.nablahog_vector_bytes()} bits' if library else 'no compiled loops'}"


def _name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())
