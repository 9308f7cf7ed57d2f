"""The struct that Python fills in has the fields of the one that the native loops read."""

from __future__ import annotations

import ctypes
import re

import nablahog.native
from nablahog.hog.kernels.tables import AxisStruct, TablesStruct

TYPES = {"int64_t": ctypes.c_int64, "int32_t": ctypes.c_int32, "double": ctypes.c_double}


def declared(struct: str) -> list[tuple[str, object]]:
    """Names and types of a struct of ``tables.h``, in its order."""
    text = (nablahog.native._SOURCES / "tables.h").read_text(encoding="utf-8")
    found = re.search(rf"struct {struct} \{{(.*?)\}};", re.sub(r"//.*", "", text), re.DOTALL)
    assert found
    fields: list[tuple[str, object]] = []
    for line in filter(None, map(str.strip, found[1].split(";"))):
        kind, names = line.removeprefix("const ").removeprefix("struct ").split(" ", 1)
        if kind.endswith("*"):
            fields.append((names, ctypes.c_char_p if kind == "char*" else ctypes.c_void_p))
        else:
            fields += [(name, AxisStruct if kind == "nablahog_axis" else TYPES[kind]) for name in names.split(", ")]
    return fields


def test_structs_have_the_fields_of_the_header() -> None:
    assert AxisStruct._fields_ == declared("nablahog_axis")
    assert TablesStruct._fields_ == declared("nablahog_tables")
