"""Memory that is used again holds nothing that is still in use."""

from __future__ import annotations

import gc

import numpy as np
import torch

from nablahog.hog.kernels import memory

LARGE = (3, 2**18)  # float32: 3 MiB


def place(array: object) -> int:
    assert isinstance(array, np.ndarray)
    return int(array.__array_interface__["data"][0])


def test_arrays_in_use_are_apart() -> None:
    arrays = [memory.empty(LARGE, np.float32) for _ in range(40)]  # more than are kept
    for k, array in enumerate(arrays):
        array[:] = k
    assert all((array == k).all() for k, array in enumerate(arrays))


def test_memory_comes_back_with_the_last_tensor_on_it() -> None:
    memory._free.clear()
    array = memory.empty(LARGE, np.float32)
    first, part = place(array), torch.from_numpy(array)[1:, 5:].requires_grad_()
    part_of = part.detach()[-1:]
    del array, part
    gc.collect()
    other = memory.empty(LARGE, np.float32)
    assert place(other) != first  # a view of a view is left
    del part_of
    gc.collect()
    assert place(memory.empty(LARGE, np.float32)) == first


def test_other_sizes_and_kinds() -> None:
    for shape, kind in (((), np.float64), ((0, 7), np.float32), ((2**17, 3), np.float64), ((2**27,), np.uint8)):
        array = memory.empty(shape, kind)
        assert array.shape == shape
        assert array.dtype == kind
        assert array.flags["C_CONTIGUOUS"]
    assert sum(block.nbytes for block in memory._free) <= 2**26
