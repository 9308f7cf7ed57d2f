"""Reading our .npz archives, whoever wrote them: nothing in one is ever unpickled, so nothing in it is ever run."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MAX_BYTES = 2**30  # what an archive may unpack to: a descriptor of 270 megapixels at 31 channels and cells of 8


def read_arrays(path: str | os.PathLike[str], kind: str, names: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """The arrays ``names`` of the archive ``path``.

    Args:
        path: the file.
        kind: what it is expected to be, such as "descriptor file", for the messages.
        names: of the arrays that it must have; others are not read.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no archive, is damaged, lacks an array, holds pickled objects or unpacks to too much.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
    except Exception as error:  # zipfile has no common base for what damage makes it raise
        raise ValueError(f"{path}: expected a {kind} (.npz), but it cannot be read: {error}") from None
    if size > MAX_BYTES:
        raise ValueError(f"{path}: the archive unpacks to {size:,} bytes, more than the {MAX_BYTES:,} allowed")
    try:
        # opened here, because numpy leaves damaged files open
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            missing = [name for name in names if name not in archive]
            arrays = {} if missing else {name: archive[name] for name in names}
    except Exception as error:  # a damaged archive fails in zipfile, zlib or numpy, each with its own kinds of error
        if "allow_pickle" in str(error):
            raise ValueError(f"{path}: the archive holds pickled objects, which are never loaded") from None
        raise ValueError(f"{path}: the archive is damaged: {error}") from None
    if missing:
        raise ValueError(f"{path}: expected a {kind}, but the archive lacks {', '.join(missing)}")
    return arrays


def text(arrays: dict[str, NDArray[np.generic]], name: str) -> str:
    """The string that the array ``name`` holds.

    Raises:
        ValueError: it holds none.
    """
    array = arrays[name]
    if array.shape != () or array.dtype.kind != "U":
        raise ValueError(f"{name} must be one string, got {array.dtype} of shape {array.shape}")
    return str(array.item())


def check_format(arrays: dict[str, NDArray[np.generic]], kind: str, expected: int) -> None:
    """Raises ValueError unless the array ``format`` is the version ``expected``."""
    version = arrays["format"]
    if version.shape != () or version.item() != expected:
        raise ValueError(f"this version reads {kind}s of format {expected}, got {version!s}")
