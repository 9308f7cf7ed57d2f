"""The struct that Python fills in is the one that the native loops read."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

import pytest

from nablahog import native
from nablahog.hog.kernels.plan import PlanStruct


def values(struct: ctypes.Structure) -> Iterator[float]:
    """Of all fields, in the order in which Python declares them; of pointers the address."""
    for name, kind in struct._fields_:
        if issubclass(kind, ctypes.Structure):
            yield from values(getattr(struct, name))
        elif kind is ctypes.c_char_p:
            at = ctypes.addressof(struct) + getattr(type(struct), name).offset
            yield ctypes.c_void_p.from_address(at).value or 0
        else:
            yield getattr(struct, name) or 0


@pytest.mark.skipif(not native.available(), reason="no native loops")
def test_the_struct_has_the_same_fields_on_both_sides() -> None:
    struct = PlanStruct()
    native.function("number_fields", ctypes.c_void_p)(ctypes.addressof(struct))
    numbered = list(values(struct))
    assert numbered == list(range(1, len(numbered) + 1))
