"""The compiled loops: C++ behind a plain C interface, called by ctypes.

``CMakeLists.txt`` builds ``core.so``, which knows the level of x86-64, and ``core_v2.so`` … ``core_v4.so``,
one for each set of instructions: all for a wheel, the processor's own in a checkout.  On other processors ``core.so``
has the loops.  Without them the package runs on plain PyTorch.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..runtime.advice import warn_caller

INSTRUCTIONS = "NABLAHOG_INSTRUCTIONS"
"""Environment variable with the best instructions to use: ``none`` (plain PyTorch), ``v2``, ``v3`` or ``v4``."""
LIBRARY_FOLDER = "NABLAHOG_NATIVE"
"""Environment variable with another folder to load the libraries from, such as one built with sanitizers."""
_SOURCES = Path(__file__).parent
_INSTRUCTION_LEVELS = {"none": 0, "v2": 2, "v3": 3, "v4": 4}


@cache
def library() -> ctypes.CDLL | None:
    """The library for this processor; None, with one warning, if there is none.

    Raises:
        RuntimeError: this is a checkout, a source has changed since the libraries were built, and they cannot be built
            again.
        ValueError: the environment asks for instructions that are unknown.
    """
    wanted = os.environ.get(INSTRUCTIONS, "v4")
    if wanted not in _INSTRUCTION_LEVELS:
        raise ValueError(f"{INSTRUCTIONS} must be one of {', '.join(_INSTRUCTION_LEVELS)}, got {wanted!r}")
    if wanted == "none":
        return None
    core = Path(os.environ.get(LIBRARY_FOLDER, _SOURCES)) / "core.so"  # on every system
    if core.exists() and changed_since(core):
        _build_again(core)
    best = _best_library(core, _INSTRUCTION_LEVELS[wanted]) if core.exists() else None
    if best is None:
        warn_caller(
            f"nablahog has no compiled loops for {'this processor' if wanted == 'v4' else wanted}, and runs many times "
            "slower on plain PyTorch: install a C++ compiler (g++ 12 or clang++ 14, or newer), then nablahog again, in "
            "a checkout by `make native`",
            RuntimeWarning,
        )
        return None
    changed = changed_since(best)
    if changed:
        names = ", ".join([*changed[:2], "…"] if len(changed) > 2 else changed)
        raise RuntimeError(f"{names} changed after the compiled loops were built: run `make native`")
    return ctypes.CDLL(str(best))


def _best_library(core: Path, wanted: int) -> Path | None:
    """The library with the highest instructions that the processor has and the environment allows."""
    level = ctypes.CDLL(str(core)).nablahog_level()
    if not level:  # not x86-64
        return core
    libraries = (core.with_stem(f"core_v{k}") for k in range(min(wanted, level), 1, -1))
    return next(filter(Path.exists, libraries), None)


def available() -> bool:
    """Whether there are compiled loops."""
    return library() is not None


# torch.compile must not trace how a library is found.  This is what torch.compiler.assume_constant_result does once it
# has loaded torch._dynamo, which takes a second.
available._dynamo_marked_constant = True  # type: ignore[attr-defined]


def changed_since(core: Path) -> list[str]:
    """The sources that are not those a library was built from; an installed package has none.

    Only those newer than the library are read: a copied checkout can have other dates, and is the same.
    """
    built = core.stat().st_mtime
    sources = (file for file in os.scandir(_SOURCES) if file.name.endswith((".cpp", ".h")))
    newer = sorted(file.name for file in sources if file.stat().st_mtime > built)
    hashes = core.with_suffix(".sha256")  # by CMake
    known = hashes.read_text().splitlines() if newer and hashes.exists() else []
    return [name for name in newer if f"{sha256((_SOURCES / name).read_bytes()).hexdigest()}  {name}" not in known]


def _build_again(core: Path) -> None:
    """Builds the libraries of a checkout again, as ``make native`` did; one process does, others wait."""
    from filelock import FileLock  # which PyTorch brings along

    build = _SOURCES.parents[2] / "build" / "native"
    cmake = shutil.which("cmake", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    configured = build / "CMakeCache.txt"
    if cmake is None or core.parent != _SOURCES or not configured.exists():
        return
    home = re.search("^CMAKE_HOME_DIRECTORY:INTERNAL=(.*)$", configured.read_text(), re.MULTILINE)
    if home is None or Path(home[1]).resolve() != _SOURCES.parents[2].resolve():
        return  # it would build the checkout that this one is a copy of
    with FileLock(build / "lock"):
        if changed_since(core):
            subprocess.run([cmake, "--build", build], capture_output=True, check=False)


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
    allowed = frozenset(map(np.dtype, dtypes))
    tensor_dtypes = frozenset(getattr(torch, dtype.name) for dtype in allowed)

    class Address:
        @staticmethod
        def from_param(value: Any) -> ctypes.c_void_p:
            if isinstance(value, Tensor):
                if value.dtype in tensor_dtypes and value.is_contiguous() and value.is_cpu:
                    return ctypes.c_void_p(value.data_ptr())
            elif value.dtype in allowed and value.flags.c_contiguous:
                return ctypes.c_void_p(_address(value))
            names = " or ".join(sorted(map(str, allowed)))
            raise TypeError(f"expected a C-contiguous array of {names} on a CPU, got {value.dtype}{[*value.shape]}")

    return Address


def _address(values: np.ndarray[Any, Any]) -> int:
    """The address of the first element."""
    if values.size and values.flags.writeable:
        buffer: Any = values  # a quarter of the time of the line below
        return ctypes.addressof(ctypes.c_char.from_buffer(buffer))
    return values.ctypes.data
