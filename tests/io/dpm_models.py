"""Models of voc-release5, written as MATLAB would write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

ROOT, PART = (3, 4, 32), (2, 2, 32)


def structs(rows: list[dict[str, Any]]) -> np.ndarray[Any, Any]:
    """A MATLAB struct array."""
    names = list(rows[0])
    result = np.zeros(len(rows), dtype=[(name, object) for name in names])
    for number, row in enumerate(rows):
        result[number] = tuple(row[name] for name in names)
    return result


def cells(items: list[Any]) -> np.ndarray[Any, Any]:
    result = np.empty(len(items), dtype=object)
    result[:] = items
    return result


def weights(shape: tuple[int, ...], seed: int) -> np.ndarray[Any, Any]:
    return np.random.default_rng(seed).standard_normal(shape)


def model(**changes: Any) -> dict[str, Any]:
    """One component of a root and two parts, and its mirror image.

    Symbols: 1 the start; 2, 4, 6 the deformed root and parts; 3, 5, 7 their filters; 8 to 13 the same, mirrored.
    """
    blocks = structs(
        [
            {"w": weights(shape, k).flatten(order="F"), "shape": np.array(shape, np.uint8)}
            for k, shape in enumerate((ROOT, PART, PART))
        ]
    )
    filters = structs(
        [{"blocklabel": 1 + k % 3, "flip": k // 3, "symbol": 3 + 2 * k, "size": np.array([1, 1])} for k in range(6)]
    )
    symbols = structs(
        [
            {"type": "T" if k % 2 and k > 1 else "N", "filter": (k - 1) // 2 if k % 2 and k > 1 else 0}
            for k in range(1, 14)
        ]
    )
    anchors = [np.array(a, float) for a in ([0, 0, 0], [1, 2, 1], [2, 3, 1])]
    start = structs(
        [
            {"type": "S", "rhs": np.array([2, 4, 6]), "anchor": cells(anchors)},
            {"type": "S", "rhs": np.array([8, 10, 12]), "anchor": cells(anchors)},
        ]
    )
    rules = [start] + [
        structs([{"type": "D", "rhs": k + 1, "anchor": np.array([])}]) if k % 2 == 0 else np.array([])
        for k in range(2, 14)
    ]
    stored = {
        "class": "toy",
        "sbin": 8,
        "start": 1,
        "filters": filters,
        "blocks": blocks,
        "symbols": symbols,
        "rules": cells(rules),
    }
    return {**stored, **changes}


def written(path: Path, **changes: Any) -> Path:
    savemat(path, {"model": {k: v for k, v in model(**changes).items() if v is not None}})
    return path
