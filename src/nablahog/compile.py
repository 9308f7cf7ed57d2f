"""Loops compiled by numba."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import Any


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` in machine code, made at its first call and kept on disk where a folder for that can be written.

    Products and sums may be fused, but never re-ordered: NaN, infinities and equal inputs keep their meaning.
    """

    @cache
    def machine_code() -> Callable[..., Any]:
        import numba  # here, since it takes most of a second to load

        options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
        try:
            kept: Callable[..., Any] = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # there is no folder to keep it in
            kept = numba.njit(**options)(function)
        return kept

    @wraps(function)
    def call(*arguments: Any) -> Any:
        return machine_code()(*arguments)

    return call
