"""Differences of two specs: groups of conventions that can be exchanged one after the other."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from ..hog import HOGSpec

# The fields of each group, with their names for readers.  "normalizer.x" is the field x of two normalisers of a kind.
_GROUPS: tuple[dict[str, str], ...] = (
    {"gamma": "gamma", "value_range": "value range"},
    {"colour": "colour rule"},
    {"colour_ties": "colour ties"},
    {"mask": "mask", "border": "border"},
    {"bins": "bins", "signed": "bins", "bin_offset": "bins", "counterclockwise": "bins"},
    {"vote": "votes", "angle": "arctangent", "directions": "direction table", "boundary": "bin ties"},
    {"partial_cells": "partial cells", "pooling": "pooling"},
)


@dataclass(frozen=True)
class Convention:
    """Fields of a spec that are exchanged together.

    Attributes:
        name: for readers.
        fields: names of fields of the spec, or "normalizer.x".
    """

    name: str
    fields: tuple[str, ...]

    def settings(self, spec: HOGSpec) -> str:
        """The values of its fields in a spec, as text."""
        return ", ".join(f"{field.split('.')[-1]}={_text(_get(spec, field))}" for field in self.fields)


def _get(spec: HOGSpec, field: str) -> Any:
    value: Any = spec
    for name in field.split("."):
        value = getattr(value, name)
    return value


def _text(value: Any) -> str:
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return f"{value:g}" if isinstance(value, float) else str(value)
    fields = ", ".join(f"{each.name}={_text(getattr(value, each.name))}" for each in dataclasses.fields(value))
    return f"{value.kind}({fields})"  # type: ignore[attr-defined]


def essential(spec: HOGSpec, channels: int) -> HOGSpec:
    """Resets the fields of a spec that have no effect on 8-bit images with so many channels.

    Two specs of the same descriptors are then equal, up to normalisers.
    """
    hard, one = spec.vote == "hard", channels == 1
    changes: dict[str, Any] = {"name": "", "layout": "cells", "derivative": "own"}
    changes |= {"angle": "exact"} if hard else {"directions": "float32", "boundary": "first"}
    if one:
        changes |= {"colour": "gray"}
    if one or spec.colour != "largest":
        changes |= {"colour_ties": "first"}
    return dataclasses.replace(spec, **changes)


def differing(a: HOGSpec, b: HOGSpec) -> list[Convention]:
    """The groups of conventions in which two specs differ, in the order in which a HOG applies them.

    The name, the layout, the derivative and the cell size are ignored.  A group is named after its fields that differ.
    """
    differences = []
    for group in _GROUPS + _of_normalizers(a, b):
        names = [name for field, name in group.items() if _get(a, field) != _get(b, field)]
        names = next(([name] for name in ("votes", "bin ties") if name in names), names)  # the others are their details
        if names:
            fields = tuple(field for field in group if _get(a, field) != _get(b, field))
            differences.append(Convention(" and ".join(dict.fromkeys(names)), fields))
    return differences


def _of_normalizers(a: HOGSpec, b: HOGSpec) -> tuple[dict[str, str], ...]:
    groups = a.normalizer.conventions if a.normalizer.kind == b.normalizer.kind else ()
    return tuple({f"normalizer.{field}": name for field, name in group.items()} for group in groups) or (
        {"normalizer": "normaliser"},
    )


def exchanged(a: HOGSpec, b: HOGSpec, conventions: Iterable[Convention]) -> HOGSpec:
    """``a`` with some conventions of ``b``.

    Raises:
        ValueError: these conventions cannot be combined.
    """
    changes: dict[str, Any] = {}
    of_normalizer: dict[str, Any] = {}
    for field in itertools.chain.from_iterable(each.fields for each in conventions):
        *part, name = field.split(".")
        (of_normalizer if part else changes)[name] = _get(b, field)
    if of_normalizer:
        changes["normalizer"] = dataclasses.replace(a.normalizer, **of_normalizer)
    return dataclasses.replace(a, **changes)


def exchangeable(
    a: HOGSpec, b: HOGSpec, accept: Callable[[HOGSpec], bool] = lambda spec: True
) -> tuple[list[Convention], list[HOGSpec]]:
    """The conventions in which two specs differ, and all mixtures of both.

    Conventions that cannot be exchanged one without the other are merged, "this + that": as long as some mixture is
    refused, the two conventions are merged that leave the fewest refused mixtures.

    Args:
        a, b: two specs of :func:`essential`, with cells of one size.
        accept: whether a mixture can be used; it holds for ``a`` and ``b``.

    Returns:
        The conventions; and ``a`` with every subset of those of ``b``: mixture s has the conventions whose bits are set
        in s, of which the first is the highest.
    """

    def mixture(subset: Iterable[bool]) -> HOGSpec | None:
        try:
            spec = exchanged(a, b, itertools.compress(conventions, subset))
        except ValueError:
            return None
        return spec if accept(spec) else None

    conventions = differing(a, b)
    subsets = itertools.product((False, True), repeat=len(conventions))
    mixtures = [(subset, mixture(subset)) for subset in subsets]
    while None in (spec for _, spec in mixtures):
        refused = [subset for subset, spec in mixtures if spec is None]
        pairs = itertools.combinations(range(len(conventions)), 2)
        i, j = min(pairs, key=lambda pair: sum(subset[pair[0]] == subset[pair[1]] for subset in refused))
        one, other = conventions[i], conventions.pop(j)
        conventions[i] = Convention(f"{one.name} + {other.name}", one.fields + other.fields)
        mixtures = [(subset[:j] + subset[j + 1 :], spec) for subset, spec in mixtures if subset[i] == subset[j]]
    return conventions, [spec for _, spec in mixtures if spec]
