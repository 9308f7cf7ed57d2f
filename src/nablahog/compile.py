"""Loops compiled by numba."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache, update_wrapper
from types import FunctionType
from typing import Any


class _Compiled:
    """A function in machine code, made at its first call and kept on disk where a folder for that can be written."""

    def __init__(self, function: FunctionType) -> None:
        update_wrapper(self, function)
        self.function = function
        self.machine_code = cache(self._compile)  # not while a module is imported: numba takes most of a second to load

    def __call__(self, *arguments: Any) -> Any:
        return self.machine_code()(*arguments)

    def _calls(self) -> dict[str, _Compiled]:
        """The compiled functions that this one calls by a name of its module."""
        function = self.function
        named = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        return {name: each for name, each in named.items() if isinstance(each, _Compiled)}

    def _digest(self) -> str:
        """Of all that the machine code is made of."""
        code = self.function.__code__
        parts = code.co_code.hex(), repr(code.co_consts), *(each._digest() for each in self._calls().values())
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _compile(self) -> Callable[..., Any]:
        import numba

        function = self.function
        if calls := self._calls():
            # What numba keeps, it keeps until the file of this function changes.  One that includes others, of other
            # files, needs a name for each state of them.
            known = function.__globals__ | {name: each.machine_code() for name, each in calls.items()}
            function = FunctionType(function.__code__, known, function.__name__)
            function.__module__ = self.function.__module__
            function.__qualname__ = f"{self.function.__qualname__}_{self._digest()[:16]}"
        options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
        try:
            kept: Callable[..., Any] = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # there is no folder to keep it in
            kept = numba.njit(**options)(function)
        return kept


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` in machine code, which may call other compiled functions by the names that its module has for them.

    Products and sums may be fused, but never re-ordered: NaN, infinities and equal inputs keep their meaning.
    """
    assert isinstance(function, FunctionType)
    return _Compiled(function)
