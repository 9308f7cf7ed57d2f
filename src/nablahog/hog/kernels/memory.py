"""Large arrays from memory that was in use before: a system takes longer to give new pages than loops to fill them."""

from __future__ import annotations

import math
import sys
import threading
from typing import Any

import numpy as np
import numpy.typing as npt

_LARGE = 2**20  # bytes of an array that is worth it
_MOST = 2**26  # that are kept, in use or not
_UNUSED = 3  # references to a block that only the list, a loop's variable and the call that counts them hold

_blocks: list[npt.NDArray[np.uint8]] = []
_lock = threading.Lock()


def empty(shape: tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
    """As :func:`numpy.empty`; memory comes back when the last array or tensor on it is gone."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if not _LARGE <= size <= _MOST:
        return np.empty(shape, dtype)
    with _lock:
        block = _unused(size)
        if block is None:
            block = np.empty(size, np.uint8)
            _blocks.append(block)
            _drop()
        found: npt.NDArray[Any] = block[:size].view(dtype).reshape(shape)
        return found


def _unused(size: int) -> npt.NDArray[np.uint8] | None:
    for block in _blocks:
        if size <= block.nbytes <= 2 * size and sys.getrefcount(block) == _UNUSED:
            return block
    return None


def _drop() -> None:
    """Forgets the oldest blocks while there are too many; those in use are then freed with what uses them."""
    while sum(block.nbytes for block in _blocks) > _MOST:
        _blocks.pop(0)
