"""Models of voc-release5 (DPM), as MATLAB files: their root and part filters, unfolded into templates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import interpolate

from ..runtime.text import one_line
from .input_file import Readable
from .matfile import read_mat

CHANNELS = 32
MAX_FILTER_SIDE = 1000  # along a filter's side
MAX_WEIGHTS = 2**24  # weights of all filters; published models have some hundred thousand
MOST = 10**6  # the largest index, place or size of a cell
_ROOT, _PARTS = 0, 1  # octaves between their cells and the root's


@dataclass(frozen=True)
class Filter:
    """A linear template of a model: a name such as ``"component 1, root"``, and weights (rows, cols, 32), float32."""

    name: str
    weights: Tensor


@dataclass(frozen=True)
class DPMModel:
    """A model's templates.

    Attributes:
        class_name: what it detects.
        cell_size: ``sbin``, pixels of a cell.
        filters: of each component that is not another's mirror image, the root, and all its parts where they are
            expected, at twice the resolution: where two overlap, their mean, and where there is none, the root.
    """

    class_name: str
    cell_size: int
    filters: tuple[Filter, ...]


def is_dpm_file(path: Readable) -> bool:
    """Whether a file is a MATLAB file that holds a struct ``model`` with filters."""
    try:
        return "filters" in read_mat(path)["model"][0]
    except (OSError, ValueError, LookupError, TypeError):
        return False


def load_dpm(path: Readable) -> DPMModel:
    """The templates of the model in a file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no MATLAB file of version 5 to 7, holds no model, or one whose parts contradict each other.
    """
    stored = read_mat(path)
    try:
        return _unfold(stored["model"][0])
    except (LookupError, TypeError, ValueError) as error:
        reason = one_line(f"it has no {error}" if isinstance(error, KeyError) else error)
        raise ValueError(f"{path}: expected a model of voc-release5, but {reason}") from None


def _to_integers(numbers: Any) -> list[int]:
    """Numbers as MATLAB has them, perhaps floating-point; ValueError for a fraction, or what is larger than any."""
    array = np.asarray(numbers, np.float64).reshape(-1)
    if not (np.abs(array) <= MOST).all() or (array != np.floor(array)).any():
        raise ValueError(f"it holds numbers that are not integers within ±{MOST:,}")
    return [int(number) for number in array]


def _to_integer(number: Any) -> int:
    return _to_integers(number)[0]


def _item(items: Any, number: int) -> Any:
    """One of a list, counted from 1."""
    if not isinstance(items, list) or not 1 <= number <= len(items):
        raise ValueError(f"it refers to number {number} of a list that does not have it")
    return items[number - 1]


def _unfold(model: dict[str, Any]) -> DPMModel:
    filters: list[Filter] = []
    number = numbers = 0
    for rule in _item(model["rules"], _to_integer(model["start"])):
        symbols, anchors = _to_integers(rule["rhs"]), [_to_integers(anchor) for anchor in rule["anchor"]]
        if len(symbols) != len(anchors) or any(len(anchor) != 3 for anchor in anchors):
            raise ValueError("a component has not one place for each of its filters")
        placed: list[tuple[NDArray[np.float32], bool, int, int, int]] = []
        for symbol, anchor in zip(symbols, anchors, strict=True):
            weights, flipped = _find_filter(model, symbol)
            x, y, octave = anchor
            placed.append((weights, flipped, x, y, octave))
            numbers += weights.size * (5 if octave == _ROOT else 1)  # a root's parts are on four times its cells
            if numbers > MAX_WEIGHTS:
                raise ValueError(f"its components have more than {MAX_WEIGHTS:,} weights")
        if any(flipped for _, flipped, *_ in placed):
            continue  # the mirror image of another component
        number += 1
        roots = [weights for weights, _, _, _, octave in placed if octave == _ROOT]
        if len(roots) != 1:
            raise ValueError(f"a component has {len(roots)} roots")
        (root,) = roots
        filters.append(Filter(f"component {number}, root", torch.from_numpy(root)))
        parts = [(weights, x, y) for weights, _, x, y, octave in placed if octave == _PARTS]
        if parts:
            filters.append(Filter(f"component {number}, parts", torch.from_numpy(_merge_parts(root, parts))))
    if not filters:
        raise ValueError("it has no component")
    if not isinstance(model["class"], str):
        raise ValueError("its class is not text")
    return DPMModel(model["class"], _to_integer(model["sbin"]), tuple(filters))


def _find_filter(model: dict[str, Any], symbol: int) -> tuple[NDArray[np.float32], bool]:
    """The weights that a symbol of the grammar ends in, and whether they are used mirrored."""
    for _ in range(len(model["symbols"])):
        entry = _item(model["symbols"], symbol)
        if entry["type"] == "T":
            filter_entry = _item(model["filters"], _to_integer(entry["filter"]))
            return _read_weights(_item(model["blocks"], _to_integer(filter_entry["blocklabel"]))), bool(
                _to_integer(filter_entry["flip"])
            )
        symbol = _to_integer(_item(_item(model["rules"], symbol), 1)["rhs"])
    raise ValueError("its grammar does not end")


def _read_weights(block: dict[str, Any]) -> NDArray[np.float32]:
    shape = tuple(_to_integers(block["shape"]))
    if len(shape) != 3 or shape[2] != CHANNELS or not 0 < min(shape) <= max(shape) <= MAX_FILTER_SIDE:
        raise ValueError(f"a filter has the shape {shape}, not (rows, cols, {CHANNELS})")
    weights = np.asarray(block["w"], np.float64).reshape(shape, order="F")
    if not (np.abs(weights) <= np.finfo(np.float32).max).all():  # NaN fails too
        raise ValueError("a filter holds NaN or Inf, or more than fits float32")
    return np.ascontiguousarray(weights, np.float32)


def _merge_parts(root: NDArray[np.float32], parts: list[tuple[NDArray[np.float32], int, int]]) -> NDArray[np.float32]:
    """Parts at their places in the root's frame, of twice its rows and columns; elsewhere the root, interpolated.

    The root is scaled so that, where there are parts, it has as much energy as they have.
    """
    whole = np.zeros((2 * root.shape[0], 2 * root.shape[1], CHANNELS), np.float32)
    count = np.zeros((*whole.shape[:2], 1), np.float32)
    for weights, x, y in parts:
        rows, cols = weights.shape[:2]
        if min(x, y) < 0 or y + rows > whole.shape[0] or x + cols > whole.shape[1]:
            raise ValueError(f"a part of {rows}x{cols} cells at {y}, {x} is outside its root")
        whole[y : y + rows, x : x + cols] += weights
        count[y : y + rows, x : x + cols] += 1
    whole /= np.maximum(count, 1)
    doubled = interpolate(torch.from_numpy(root).permute(2, 0, 1)[None], scale_factor=2, mode="bilinear")
    background = doubled[0].permute(1, 2, 0).numpy()
    scale = np.linalg.norm(whole) / max(np.linalg.norm(background * (count > 0)), np.finfo(np.float32).tiny)
    return np.where(count > 0, whole, background * np.float32(scale))
