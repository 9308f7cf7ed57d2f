"""Files that do not hold what was saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def arrays_of(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def rewrite(path: Path, **changed: Any) -> None:
    """Changes arrays of an archive; those that are None are gone."""
    arrays = {**arrays_of(path), **changed}
    with open(path, "wb") as file:
        np.savez(file, **{name: value for name, value in arrays.items() if value is not None})


def damages(whole: bytes) -> list[bytes]:
    """What can become of a file of some kilobytes: cut short, overwritten, or with one byte turned."""
    middle = len(whole) // 2
    turned = whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]
    return [b"", b"hello", whole[:100], whole[:middle], whole[:-1], turned]
