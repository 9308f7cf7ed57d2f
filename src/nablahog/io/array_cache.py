"""Arrays that take long to compute, kept in the user's folder for caches.

Files hold a digest and numbers, and nothing that is run.  A damaged file counts as missing.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..runtime.cache import cache_folder
from .files import remove_parts, replacing

SIZE_VARIABLE = "NABLAHOG_CACHE_SIZE"
DEFAULT_MEGABYTES = 2000
ENDING = ".array"
_ROOM = 0.8  # of the largest size: what is kept when the least recently used arrays are removed
_DIGEST = 32  # bytes before the numbers


def cached_array(
    kind: str, key: str, shape: tuple[int, ...], make: Callable[[], NDArray[np.float32]]
) -> NDArray[np.float32]:
    """An array (float32) that an earlier process stored, or that is made and stored now.

    It lies in the folder ``kind`` of the user's caches; the key is a hash of everything that it depends on, including
    the code.  The environment variable :data:`SIZE_VARIABLE` says how many megabytes the arrays of a kind may have, by
    default :data:`DEFAULT_MEGABYTES`; with 0 there is no cache.  Where the folder cannot be written, arrays are made
    each time.  The result can be written to; stored arrays are mapped to memory, of which the system frees what it
    needs.
    """
    largest = 1e6 * DEFAULT_MEGABYTES
    with suppress(ValueError):
        largest = 1e6 * float(os.environ.get(SIZE_VARIABLE) or DEFAULT_MEGABYTES)
    if largest <= 0:
        return make()
    try:
        path = cache_folder() / kind / f"{key}{ENDING}"
    except FileNotFoundError:  # no home folder
        return make()
    with suppress(OSError, ValueError):  # missing, or damaged
        if path.stat().st_size == _DIGEST + 4 * int(np.prod(shape)):
            stored = np.memmap(path, np.float32, "c", _DIGEST, shape)  # PyTorch takes no read-only memory
            with open(path, "rb") as file:
                digest = file.read(_DIGEST)
            if digest == _digest(stored, key):
                os.utime(path)  # it was used
                return stored
    array = np.ascontiguousarray(make(), np.float32)
    assert array.shape == shape
    with suppress(OSError):  # a full disk, say
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as file:
            file.write(_digest(array, key))
            file.write(array.data)
        _tidy(path.parent, largest)
    return array


def _digest(array: NDArray[np.float32], key: str) -> bytes:
    hashed = hashlib.sha256(key.encode())
    hashed.update(array.data)
    return hashed.digest()


def _tidy(folder: Path, largest: float) -> None:
    """Removes the arrays that were not used for longest, if all of them have more bytes than ``largest``."""
    remove_parts(folder)
    states = sorted((path.stat().st_mtime, path.stat().st_size, path) for path in folder.glob(f"*{ENDING}"))
    size = sum(size for _, size, _ in states)
    allowed = size if size <= largest else _ROOM * largest
    for _, file_size, path in states:
        if size <= allowed:
            return
        path.unlink(missing_ok=True)
        size -= file_size
