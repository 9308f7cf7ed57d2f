"""Large arrays from memory that was in use before: a system takes longer to give new pages than loops to fill them."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
import numpy.typing as npt

Block = npt.NDArray[np.uint8]

_LARGE = 2**20  # bytes of an array that is worth it
_MOST = 2**26  # that are kept for later

_free: deque[Block] = deque()


class _Loan:
    """Stands for an array on a block: arrays and tensors that share its memory hold it, and with the last it ends."""

    def __init__(self, block: Block, array: npt.NDArray[Any]) -> None:
        self.block, self.__array_interface__ = block, array.__array_interface__

    def __del__(self, free: deque[Block] = _free, most: int = _MOST) -> None:
        free.append(self.block)
        while sum(block.nbytes for block in tuple(free)) > most:
            free.popleft()


def empty(shape: tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
    """As :func:`numpy.empty`; memory comes back when the last array or tensor on it is gone."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if not _LARGE <= size <= _MOST:
        return np.empty(shape, dtype)
    block = _taken(size)
    return np.asarray(_Loan(block, block[:size].view(dtype).reshape(shape)))


def _taken(size: int) -> Block:
    """A block of at least ``size`` bytes, free and not much larger, or new."""
    for _ in range(len(_free)):
        try:
            block = _free.popleft()  # by one thread only
        except IndexError:
            break
        if size <= block.nbytes <= 2 * size:
            return block
        _free.append(block)
    return np.empty(size, np.uint8)
