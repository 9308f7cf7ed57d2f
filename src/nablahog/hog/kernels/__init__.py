"""The operator's steps as native loops for CPUs: the same results up to rounding, and the same derivatives.

``docs/kernels.md`` explains them; ``tests/hog/kernels`` compares them with the reference steps.
"""

from __future__ import annotations

from ... import native
from ..engine import REFERENCE, Engine
from ..spec import HOGSpec
from .loops import NativeCells, NativeDescribe, NativeNorm

NATIVE_ENGINE = Engine(NativeCells, NativeNorm, NativeDescribe)
_CELLS_ALONE = Engine(NativeCells)


def engine_of(spec: HOGSpec) -> Engine:
    """The steps of a dialect that have loops."""
    smoothed_border = spec.mask == "sobel" and spec.border not in ("reflect", "ignore")
    if smoothed_border or not native.available():
        return REFERENCE
    return NATIVE_ENGINE if spec.normalizer.has_loops else _CELLS_ALONE


def supports(spec: HOGSpec) -> bool:
    """Whether these loops have all that the dialect needs, except perhaps its normaliser."""
    return engine_of(spec) is not REFERENCE
