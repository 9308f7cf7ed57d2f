"""Arrays in the files of other programs: .npy, .npz and .mat.  Nothing in them is ever unpickled, nor run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.text import one_line
from .descriptor_file import is_descriptor_file
from .files import check_file, starts_as
from .matfile import read_mat_arrays
from .npz import check_size, names_in, numbers_in


def is_raw(path: str | os.PathLike[str]) -> bool:
    """Whether ``path`` is, by its name or its first bytes, a .npy or .mat file, or an .npz file that is not ours."""
    if _is_npy(path) or _is_mat(path):
        return True
    try:
        return is_descriptor_file(path) and "spec" not in names_in(path, "descriptor file")
    except (OSError, ValueError):  # damaged; reading it as a descriptor file will say so
        return False


def read_array(path: str | os.PathLike[str], key: str | None) -> NDArray[np.floating]:
    """The array of a .npy, .npz or .mat file.

    Args:
        path: the file.
        key: which of several arrays; None for the only one of more than one number.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, has no such array or several, or one of no floating-point numbers.
    """
    array = _chosen(path, key)
    if array.dtype.kind != "f" or array.dtype.itemsize > 8:
        raise ValueError(f"{path}: expected a descriptor of float16, float32 or float64, got {array.dtype}")
    return array


def _chosen(path: str | os.PathLike[str], key: str | None) -> NDArray[Any]:
    if _is_npy(path):
        if key is not None:
            raise ValueError(f"{path}: --key goes with .npz and .mat files, a .npy file holds one array")
        return _npy(path)
    arrays = read_mat_arrays(path) if _is_mat(path) else numbers_in(path, "archive of arrays")
    if key is not None and key in arrays:
        return arrays[key]
    if key is not None:
        raise ValueError(f"{path}: there is no array {one_line(key)!r} of numbers, {_listed(arrays)}")
    several = {name: array for name, array in arrays.items() if array.size > 1}
    if len(several) != 1:
        raise ValueError(f"{path}: expected one array or --key NAME, {_listed(arrays)}")
    (array,) = several.values()
    return array


def _listed(arrays: Mapping[str, NDArray[Any]]) -> str:
    if not arrays:
        return "the file holds no array of numbers"
    return one_line("the file holds " + ", ".join(f"{name} {array.shape}" for name, array in arrays.items()))


def _npy(path: str | os.PathLike[str]) -> NDArray[Any]:
    path = Path(path)
    check_file(path, "an array (.npy)")
    check_size(path, path.stat().st_size)
    try:
        # mapped, since a damaged header may claim any size
        array = np.lib.format.open_memmap(path, mode="r")
        return np.array(array) if array.dtype.kind == "f" else array  # copying 10¹² items of 0 bytes takes forever
    except Exception as error:  # a damaged header fails in many ways
        if "Python objects" in str(error):
            raise ValueError(f"{path}: the file holds pickled objects, which are never loaded") from None
        raise ValueError(f"{path}: expected an array (.npy), but it cannot be read: {one_line(error)}") from None


def _is_npy(path: str | os.PathLike[str]) -> bool:
    return starts_as(path, ".npy", b"\x93NUMPY")


def _is_mat(path: str | os.PathLike[str]) -> bool:
    return starts_as(path, ".mat", b"MATLAB")
