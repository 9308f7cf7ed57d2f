"""The compiled loops: C++ behind a plain C interface, called by ctypes.

``CMakeLists.txt`` builds one library for each set of instructions.  Without them the package runs on plain PyTorch.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

VARIABLE = "NABLAHOG_INSTRUCTIONS"
"""Environment variable with the best instructions to use: ``none`` (plain PyTorch), ``v2``, ``v3`` or ``v4``."""
_LEVELS = {"none": 0, "v2": 2, "v3": 3, "v4": 4}


@cache
def library() -> ctypes.CDLL | None:
    """The library for this processor; None, with one warning, if there is none."""
    wanted = os.environ.get(VARIABLE, "v4")
    if wanted not in _LEVELS:
        raise ValueError(f"{VARIABLE} must be one of {', '.join(_LEVELS)}, not {wanted!r}")
    if wanted == "none":
        return None
    found = importlib.util.find_spec(f"{__name__}.core")  # an editable installation builds it again if need be
    if found is None or found.origin is None:
        warnings.warn(
            "nablahog was installed without its compiled loops, and runs many times slower on plain PyTorch: "
            "install a C++ compiler (g++ or clang++), then nablahog again",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    core = Path(found.origin)
    level = min(_LEVELS[wanted], ctypes.CDLL(str(core)).nablahog_level())
    best = core.with_stem(f"core_v{level}") if level > 2 else core
    return ctypes.CDLL(str(best))


def available() -> bool:
    """Whether there are compiled loops."""
    return library() is not None


def can_read(*tensors: Tensor) -> bool:
    """Whether there are compiled loops that can read tensors: on a CPU, outside of function transforms."""
    try:
        return available() and all(tensor.detach().numpy() is not None for tensor in tensors)
    except (TypeError, RuntimeError):  # on another device; or with numbers that show no memory
        return False


def function(name: str, *types: Any) -> Callable[..., None]:
    """A function of the C interface, without its prefix ``nablahog_``; looked up at its first call.

    Args:
        name: of the function.  It returns 0, or 1 where memory ran out, which is raised as MemoryError.
        types: of its arguments: types of ctypes, or what :func:`array` returns.
    """
    bound: Any = None

    def call(*arguments: Any) -> None:
        nonlocal bound
        if bound is None:
            bound = getattr(library(), f"nablahog_{name}")
            bound.argtypes = types
        if bound(*arguments):
            raise MemoryError(f"not enough memory for nablahog_{name}")

    return call


@cache
def array(*dtypes: type[np.generic]) -> Any:
    """The argument type of a C-contiguous array of one of some dtypes: passed as the address of its first element.

    Tensors on a CPU are taken, too.
    """
    allowed = frozenset(np.dtype(each) for each in dtypes)

    class Address:
        @staticmethod
        def from_param(value: Any) -> ctypes.c_void_p:
            values = value.detach().numpy() if isinstance(value, Tensor) else value
            if values.dtype not in allowed or not values.flags.c_contiguous:
                names = " or ".join(sorted(map(str, allowed)))
                raise TypeError(
                    f"expected a C-contiguous array of {names}, got {values.dtype}, strides {values.strides}"
                )
            return ctypes.c_void_p(values.ctypes.data)

    return Address
