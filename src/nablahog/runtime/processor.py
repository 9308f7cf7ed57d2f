"""Levels of processors: each runs the machine code that was made for its level, on whichever machine that was."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple


class Level(NamedTuple):
    """Processors that share instructions.

    Attributes:
        name: LLVM's.
        features: instructions that all of them have, as LLVM calls them.
        vector: bytes of the vectors that loops are written with.
    """

    name: str
    features: tuple[str, ...]
    vector: int

    def environment(self) -> dict[str, str]:
        """Variables by which numba compiles for the level, in a process that starts with them."""
        return {"NUMBA_CPU_NAME": self.name, "NUMBA_CPU_FEATURES": self.flags}

    @property
    def flags(self) -> str:
        """The features as LLVM's target machine takes them."""
        return ",".join(f"+{feature}" for feature in self.features)


# as the x86-64 psABI defines its levels
_V2 = ("cx16", "sahf", "popcnt", "sse3", "sse4.1", "sse4.2", "ssse3")
_V3 = (*_V2, "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
_V4 = (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
LEVELS = Level("x86-64-v4", _V4, 64), Level("x86-64-v3", _V3, 32), Level("generic", ("neon", "fp-armv8"), 32)


@cache
def vector_bytes() -> int:
    """Bytes of the vectors that loops are written with, for the processor that numba compiles for."""
    return 64 if "avx512f" in _features() else 32


def levels() -> list[Level]:
    """Those that the processor has which numba compiles for, the best first; none where no level is known."""
    features = _features()
    return [each for each in LEVELS if features.issuperset(each.features)]


@cache
def level() -> Level | None:
    """The level whose machine code takes the place of this processor's own; None if there is none."""
    return next((each for each in levels() if each.vector == vector_bytes()), None)


def _features() -> frozenset[str]:
    from llvmlite.binding import get_host_cpu_features
    from numba.core import config

    given = config.CPU_FEATURES  # type: ignore[attr-defined]
    flags = get_host_cpu_features().flatten() if given is None else given
    return frozenset(each[1:] for each in flags.split(",") if each.startswith("+"))
