"""The structs that Python fills in have the fields of those that the native loops read."""

from __future__ import annotations

import ctypes
import re

import pytest

import nablahog.native
from nablahog.compat.opencv.windows import Padded, Scheme
from nablahog.hog.kernels.tables import AxisStruct, TablesStruct

TYPES = {
    "int64_t": ctypes.c_int64,
    "int32_t": ctypes.c_int32,
    "double": ctypes.c_double,
    "float": ctypes.c_float,
    "nablahog_axis": AxisStruct,
    "char*": ctypes.c_char_p,
}
STRUCTS = {
    "tables.h nablahog_axis": AxisStruct,
    "tables.h nablahog_tables": TablesStruct,
    "opencv_votes.h PaddedImage": Padded,
    "opencv_blocks.h Scheme": Scheme,
}


@pytest.mark.parametrize("place", STRUCTS)
def test_structs_have_the_fields_of_the_header(place: str) -> None:
    header, name = place.split()
    text = re.sub(r"//.*", "", (nablahog.native._SOURCES / header).read_text(encoding="utf-8"))
    found = re.search(rf"struct {name} \{{(.*?)\}};", text, re.DOTALL)
    assert found
    declared = re.findall(r"^  (?:const |struct )?(\w+\*?) ([\w*, ]+);", found[1], re.MULTILINE)
    assert STRUCTS[place]._fields_ == [
        (field.strip("* "), TYPES.get(kind, ctypes.c_void_p) if "*" not in field else ctypes.c_void_p)
        for kind, fields in declared
        for field in fields.split(",")
    ]
