"""Sizes as callers give them."""

from __future__ import annotations


def pair(size: int | tuple[int, int]) -> tuple[int, int]:
    """One number for both sides, or (height, width)."""
    return (size, size) if isinstance(size, int) else size
