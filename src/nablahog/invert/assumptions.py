"""What no check of an array tells of the HOG that it is found to be."""

from __future__ import annotations

import inspect

from ..hog import presets
from .candidates import Candidate

_UNTOLD = {"opencv": ("gamma", "signed", "win_sigma", "block_stride"), "skimage": ("transform_sqrt", "channel_axis")}
"""Parameters that change all numbers, but nothing that a check looks at."""
_CELL_NAMES = ("cell_size", "pixels_per_cell")
_LOCAL = ("opencv", "dalal_triggs", "maskfeat")
"""Presets of which all that holds is of one block or cell: it holds of several descriptors in one row as well."""
_REVERSIBLE = (*_LOCAL, "skimage")
"""Presets of which all that holds, holds in reverse order as well."""
_TWINS = {"uoctti": "vlfeat", "vlfeat": "uoctti"}
"""Presets that differ in how votes are shared, and in the order of axes in which their libraries return them."""
_UNORDERED = ("maskfeat", "paper")
"""Presets that are those of the mirrored image, and of the other diagonal, in any order of rows and columns."""


def describe_assumptions(candidate: Candidate, *, is_size_known: bool) -> str:
    """What no check tells of a candidate, as a clause; empty if nothing is left."""
    assumed = _parameters(candidate, is_size_known=is_size_known)
    name, in_one_row = candidate.preset, len(candidate.how.shape) == 1
    if name in _LOCAL and in_one_row and not is_size_known:
        assumed.append("one image, not several in a row")
    if name in _REVERSIBLE and in_one_row:
        assumed.append("this order, not the reverse")
    if not in_one_row and name in (*_REVERSIBLE, *_UNORDERED):
        assumed.append("axes that are rows, columns and channels as in the library, none of them reversed")
    if name in _TWINS:
        assumed.append(f"{name}, not {_TWINS[name]}")
    return f"no check tells what is assumed: {', '.join(assumed)}" if assumed else ""


def _parameters(candidate: Candidate, *, is_size_known: bool) -> list[str]:
    """The parameters that no check tells, with their defaults."""
    signature = inspect.signature(getattr(presets, candidate.preset)).parameters
    names = (*_UNTOLD.get(candidate.preset, ()), *(() if is_size_known else _CELL_NAMES))
    free = [name for name in names if name in signature and name not in candidate.parameters]
    on_size = {} if is_size_known else {"block_stride": " (on which the size depends)"}
    return [f"{name}={signature[name].default!r}{on_size.get(name, '')}" for name in free]
