"""Arrays of NumPy as tensors, and results as arrays again."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..runtime.text import describe_type

Descriptors = TypeVar("Descriptors", Tensor, NDArray[Any])
"""Descriptors as tensors or arrays: a function that takes one kind returns the same."""

ITEMS = "one call for each of them, or torch.stack or np.stack of those of one shape"


def as_descriptors(name: str, descriptor: object) -> tuple[Tensor, bool]:
    """Descriptors with B as their first of four axes, and whether an array lacked it.  Shares the memory of arrays that
    can be written to.

    Raises:
        TypeError: it is neither a dense tensor nor an array of real numbers.
        ValueError: it is an array that masks some entries.
    """
    if isinstance(descriptor, Tensor):
        check_dense(name, descriptor)
        return descriptor, False
    if not isinstance(descriptor, np.ndarray):
        came = describe_type(descriptor, path="nablahog.load_descriptor(path).descriptor", items=ITEMS)
        raise TypeError(f"{name} must be a torch tensor or a NumPy array, got {came}")
    tensor = as_tensor(name, descriptor)
    return (tensor[None], True) if tensor.dim() == 3 else (tensor, False)


def as_tensor(name: str, array: NDArray[Any]) -> Tensor:
    """An array as a tensor of the same shape.  Shares its memory if it can be written to.

    Raises:
        TypeError: its numbers are not real.
        ValueError: it masks some entries.
    """
    check_unmasked(name, array)
    if array.dtype.kind not in "uifb":
        raise TypeError(f"{name} must hold real numbers, got an array of dtype {array.dtype}")
    # PyTorch takes no other byte order and no odd strides and no longer floats, and warns of memory that is read only
    dtype = np.dtype(np.float64) if array.dtype == np.longdouble else array.dtype.newbyteorder("=")
    native = np.require(array, dtype, ["W"])
    even = all(step >= 0 and step % native.itemsize == 0 for step in native.strides)
    return torch.from_numpy(native if even else native.copy())


def check_dense(name: str, tensor: Tensor) -> None:
    """Raises TypeError for a nested or sparse tensor, whose numbers the loops cannot read."""
    if tensor.is_nested:
        raise TypeError(f"{name} must be a dense tensor, got a nested one: write one call for each of its parts")
    if tensor.layout is not torch.strided:
        raise TypeError(f"{name} must be a dense tensor, got {tensor.layout}: write tensor.to_dense()")


def check_values(name: str, tensor: Tensor) -> None:
    """Raises ValueError for a tensor on the device meta, which has a shape and no values."""
    if tensor.is_meta:
        raise ValueError(f"{name} must have values, got a tensor on the device meta: pass one on the CPU or a GPU")


def check_unmasked(name: str, array: object) -> None:
    """Raises ValueError for an array that masks some entries, which would count as if they were not masked."""
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        raise ValueError(f"{name} must have no masked entries, got an array that masks some: write array.filled(0)")


def to_array(result: Tensor, single: bool = False) -> NDArray[Any]:
    """A result (B, …) as an array, without its first axis if ``single``."""
    array: NDArray[Any] = (result[0] if single else result).detach().cpu().numpy()
    return array
