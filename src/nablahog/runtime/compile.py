"""Loops compiled by numba."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any

# Nothing is left to the compiler's taste.  Of products and sums that it may fuse, it fuses some when it makes the code
# and others when it has loaded a part of it from disk: a search that goes on in another process would end elsewhere.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


class _Instruction:
    """What a compiled function may call that numba has no word for: see :func:`instruction`."""

    def __init__(self, function: FunctionType) -> None:
        self.function = function
        self.machine_code = cache(self._resolve)

    def _resolve(self) -> Any:
        from numba.extending import intrinsic

        return intrinsic(self.function)

    def digest(self) -> str:
        """Of all that the machine code is made of: helpers in the same file and in those of ours it imports from."""
        used = {self.function.__module__, *(getattr(x, "__module__", "") for x in self.function.__globals__.values())}
        ours = f"{__name__.partition('.')[0]}."
        files = [sys.modules[name].__file__ for name in sorted(used) if name.startswith(ours)]
        return hashlib.sha256(b"".join(Path(file).read_bytes() for file in files if file)).hexdigest()


class _Compiled:
    """A function in machine code, made at its first call and kept on disk where a folder for that can be written."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.function, self.options = function, options
        self.machine_code = cache(self._compile)  # not while a module is imported: numba takes most of a second to load

    def __call__(self, *arguments: Any) -> Any:
        return self.machine_code()(*arguments)

    def for_types_of(self, *arguments: Any) -> Callable[..., Any]:
        """What a call with such arguments runs, to be called with others of the same types only.

        Nothing asks for the types then, which for many arrays takes as long as a small image.
        """
        import numba

        types = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
        code: Any = self.machine_code()  # once: several threads that come first have one of their own each
        code.compile(types)
        found: Callable[..., Any] = code.overloads[types].entry_point
        return found

    def _calls(self) -> dict[str, _Compiled | _Instruction]:
        """The compiled functions that this one calls by a name of its module."""
        function = self.function
        named = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        return {name: each for name, each in named.items() if isinstance(each, _Compiled | _Instruction)}

    def digest(self) -> str:
        """Of all that the machine code is made of."""
        code = self.function.__code__
        calls = (each.digest() for each in self._calls().values())
        known = self.function.__globals__
        constants = (repr(known[name]) for name in code.co_names if isinstance(known.get(name), int | float))
        parts = code.co_code.hex(), repr(code.co_consts), repr(self.options), *constants, *calls
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _compile(self) -> Callable[..., Any]:
        import numba

        # What numba keeps, it keeps until the file of this function changes.  What else it is made of, functions of
        # other files and the options, needs a name for each state of it.
        known = self.function.__globals__ | {name: each.machine_code() for name, each in self._calls().items()}
        function = FunctionType(self.function.__code__, known, self.function.__name__)
        function.__module__ = self.function.__module__
        function.__qualname__ = f"{self.function.__qualname__}_{self.digest()[:16]}"
        try:
            kept: Callable[..., Any] = numba.njit(cache=True, **self.options)(function)
        except RuntimeError:  # there is no folder to keep it in
            kept = numba.njit(**self.options)(function)
        return kept


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` in machine code, which may call other compiled functions by the names that its module has for them.

    Every operation is rounded by itself and in the order written: a process finds the same numbers as any other, and
    NaN, infinities and equal inputs keep their meaning.
    """
    assert isinstance(function, FunctionType)
    return _Compiled(function, _OPTIONS)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same of a small function that is called often: it becomes a part of those that call it.

    A call of its own counts up and down how many hold each array that it takes, which for a line of pixels can take
    longer than what is done with it.
    """
    assert isinstance(function, FunctionType)
    return _Compiled(function, {**_OPTIONS, "forceinline": True})


def instruction(function: Callable[..., Any]) -> Callable[..., Any]:
    """A few vector instructions, in place of a call by a compiled function.

    Args:
        function: from numba's typing context and the types of the arguments to a signature and what builds LLVM's
            instructions, as :func:`numba.extending.intrinsic` takes it.
    """
    assert isinstance(function, FunctionType)
    return _Instruction(function)  # type: ignore[return-value]
