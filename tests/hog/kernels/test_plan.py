"""The structs that Python fills in are those that the native loops read."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

import pytest

from nablahog import native
from nablahog.hog.kernels.plan import (
    BlockNormStruct,
    CellNormStruct,
    FourBlockNormStruct,
    GlobalNormStruct,
    PlanStruct,
)

STRUCTS = (PlanStruct, GlobalNormStruct, CellNormStruct, BlockNormStruct, FourBlockNormStruct)


def values(struct: ctypes.Structure | ctypes.Array[ctypes.c_int64]) -> Iterator[float]:
    """Of all fields, in the order in which Python declares them."""
    if isinstance(struct, ctypes.Array):
        yield from struct
        return
    for name, *_ in struct._fields_:
        value = getattr(struct, name)
        if isinstance(value, ctypes.Structure | ctypes.Array):
            yield from values(value)
        else:
            yield value or 0


@pytest.mark.skipif(not native.available(), reason="no native loops")
def test_structs_have_the_same_fields_on_both_sides() -> None:
    structs = [kind() for kind in STRUCTS]
    number = native.function("number_fields", *(ctypes.c_void_p for _ in structs))
    number(*(ctypes.addressof(each) for each in structs))
    for each in structs:
        numbered = list(values(each))
        assert numbered == list(range(1, len(numbered) + 1)), type(each).__name__
