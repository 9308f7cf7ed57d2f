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
import torch
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
    allowed = frozenset(map(np.dtype, dtypes))
    of_tensors = frozenset(torch.from_numpy(np.empty(0, each)).dtype for each in allowed)

    class Address:
        @staticmethod
        def from_param(value: Any) -> ctypes.c_void_p:
            if isinstance(value, Tensor):
                if value.dtype in of_tensors and value.is_contiguous() and value.is_cpu:
                    return ctypes.c_void_p(value.data_ptr())
            elif value.dtype in allowed and value.flags.c_contiguous:
                return ctypes.c_void_p(value.ctypes.data)
            names = " or ".join(sorted(map(str, allowed)))
            raise TypeError(f"expected a C-contiguous array of {names} on a CPU, got {value.dtype}, {value.shape}")

    return Address
