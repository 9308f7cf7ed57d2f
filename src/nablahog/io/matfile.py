"""MATLAB's .mat files of version 5, as numbers, texts and structures.

``scipy.io.loadmat`` reads them, too, but ends the process where a file that is damaged names a type of number it does
not know.  Nothing in a file is ever run here: objects and functions are passed over.

Source: MAT-File Format, The MathWorks, chapter 1.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from .input_file import InputFile, Readable, input_file

MAX_MAT_BYTES = 2**26  # that a file may unpack to; records of photographs have far fewer
MAX_ARRAY_BYTES = 2**29  # that its arrays may take: small numbers are stored in fewer bytes than they take
MAX_ELEMENTS = 300_000  # arrays and their parts: each becomes an object, even if it has no bytes in the file
MAX_STRUCT_DEPTH = 16  # of nested structures

_BYTE_ORDERS = {b"IM": "<", b"MI": ">"}
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHARACTERS, _OPAQUE = 1, 2, 4, 17
_CLASSES = dict(enumerate(("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"), start=6))
Parsed = TypeVar("Parsed")
_COMPLEX, _LOGICAL = 0x800, 0x200  # flags of a class


def read_mat(path: Readable) -> dict[str, Any]:
    """The variables of a .mat file by name.

    Arrays of numbers are float64 arrays of their shape, of complex ones the real parts; arrays of characters are one
    string, column by column; cells are lists; arrays of structures are lists of dictionaries by field, column by
    column.  Sparse arrays, objects and functions are None.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no .mat file of version 5, is damaged, or exceeds :data:`MAX_MAT_BYTES` or
            :data:`MAX_ELEMENTS`.
    """
    return _parse(input_file(path), _read_variables)


def read_mat_arrays(path: Readable) -> dict[str, NDArray[np.generic]]:
    """The arrays of numbers of a .mat file by name, of the types that they have in MATLAB; errors as :func:`read_mat`.

    Complex arrays are complex, too, but without their imaginary parts.
    """
    return _parse(input_file(path), _read_arrays)


def _parse(file: InputFile, parse: Callable[[bytes], Parsed]) -> Parsed:
    """What a function makes of the file's bytes; what is wrong with them is a ValueError that begins with its name."""
    file.check("a MATLAB file")
    try:
        return parse(file.read(MAX_MAT_BYTES + 1))
    except _Damaged as error:
        raise ValueError(f"{file}: expected a MATLAB file of version 5, but {error}") from None


class _Damaged(Exception):
    """Says what is wrong with the file, as the end of a sentence."""


class _Element(NamedTuple):
    kind: int
    data: memoryview


@dataclass
class _Bytes:
    """How numbers are stored, and how many elements were read so far."""

    order: str
    elements: int = 0


def _read_variables(data: bytes) -> dict[str, Any]:
    return dict(_read_matrix(element.data, order, 0) for element, order in _iterate_matrices(data))


def _read_arrays(data: bytes) -> dict[str, NDArray[np.generic]]:
    arrays, taken = {}, 0
    for element, order in _iterate_matrices(data):
        flags = _read_flags(next(_iterate_elements(element.data, order), None), order) if len(element.data) else 0
        code = _CLASSES.get(flags & 0xFF)
        if code is not None:
            name, values = _read_matrix(element.data, order, 0)
            code = "c16" if flags & _COMPLEX else "?" if flags & _LOGICAL else code
            taken += values.size * np.dtype(code).itemsize
            if taken > MAX_ARRAY_BYTES:
                raise _Damaged(f"its arrays take more than {MAX_ARRAY_BYTES:,} bytes")
            with np.errstate(all="ignore"):  # numbers of a damaged file may not fit their class
                arrays[name] = values.astype(code, copy=False)
    return arrays


def _iterate_matrices(data: bytes) -> Iterator[tuple[_Element, _Bytes]]:
    """An array of any class for each variable, unpacked, and the order of the bytes."""
    if len(data) > MAX_MAT_BYTES:
        raise _Damaged(f"it has more than {MAX_MAT_BYTES:,} bytes")
    if data[:8] == b"\x89HDF\r\n\x1a\n" or data[512:520] == b"\x89HDF\r\n\x1a\n":
        raise _Damaged("it is of version 7.3; save it with `save -v7`")
    if data[126:128] not in _BYTE_ORDERS:
        raise _Damaged("its header does not say so; if it is of version 4, save it with `save -v7`")
    order = _Bytes(_BYTE_ORDERS[data[126:128]])
    left = MAX_MAT_BYTES - len(data)
    for element in _iterate_elements(memoryview(data)[128:], order):
        if element.kind == _COMPRESSED:
            unpacked = _unpack(element.data, left)
            left -= len(unpacked)
            element = next(_iterate_elements(memoryview(unpacked), order), _Element(0, memoryview(b"")))
        if element.kind != _MATRIX:
            raise _Damaged(f"a variable is of the type {element.kind}")
        yield element, order


def _unpack(data: memoryview, most: int) -> bytes:
    stream = zlib.decompressobj()
    try:
        unpacked = stream.decompress(data, most + 1)
    except zlib.error as error:
        raise _Damaged(f"it is damaged: {error}") from None
    if len(unpacked) > most:
        raise _Damaged(f"it unpacks to more than {MAX_MAT_BYTES:,} bytes")
    if not stream.eof:
        raise _Damaged("it ends too early")
    return unpacked


def _iterate_elements(data: memoryview, order: _Bytes) -> Iterator[_Element]:
    """The elements in a row: a tag of 8 bytes and data padded to 8 bytes, or both in 8 bytes."""
    position = 0
    while position < len(data):
        order.elements += 1
        if order.elements > MAX_ELEMENTS:
            raise _Damaged(f"it has more than {MAX_ELEMENTS:,} elements")
        if len(data) - position < 8:
            raise _Damaged("it ends too early")
        first, size = (int(word) for word in np.frombuffer(data, f"{order.order}u4", 2, position))
        kind, start, padded = first, position + 8, size + (-size % 8)
        if first >> 16:
            kind, size, start, padded = first & 0xFFFF, first >> 16, position + 4, 4
        elif kind == _COMPRESSED:
            padded = size
        if start + size > len(data) or size > padded:
            raise _Damaged("it ends too early")
        yield _Element(kind, data[start : start + size])
        position = start + padded


def _read_matrix(data: memoryview, order: _Bytes, depth: int) -> tuple[str, Any]:
    """The name and the value of an array of any class; an empty element is an array without a name."""
    if depth > MAX_STRUCT_DEPTH:
        raise _Damaged(f"it has structures in each other, more than {MAX_STRUCT_DEPTH} deep")
    parts = _iterate_elements(data, order)
    if not len(data):
        return "", np.empty((0, 0))
    kind = _read_flags(next(parts, None), order) & 0xFF
    if kind == _OPAQUE:  # has no shape
        return "", None
    sides, name = _read_integers(next(parts, None), order), _read_text(next(parts, None), order)
    if len(sides) < 2 or min(sides) < 0:
        raise _Damaged("it is damaged: an array has no shape")
    count = math.prod(sides)  # in Python's numbers, which do not overflow
    if kind == _CHARACTERS:
        text = _read_text(next(parts, None), order) if count else ""
        units = len(text.encode("utf-16-le", errors="surrogatepass")) // 2
        if units != count:
            raise _Damaged(f"it is damaged: expected text of length {count}, got {units}")
        return name, text
    if kind in _CLASSES:
        values = _read_numbers(next(parts, None), order)
        if len(values) != count:
            raise _Damaged(f"it is damaged: expected an array of size {count}, got {len(values)}")
        return name, values.reshape(sides, order="F")
    if kind == _CELL:
        return name, [_read_value(part, order, depth) for part in _take(count, parts)]
    if kind == _STRUCT:
        width, names = _read_integers(next(parts, None), order), next(parts, None)
        if len(width) != 1 or width[0] < 1 or names is None:
            raise _Damaged("it is damaged: a structure has no fields")
        (name_length,) = width
        if len(names.data) > name_length * MAX_ELEMENTS:
            raise _Damaged(f"a structure has more than {MAX_ELEMENTS:,} fields")
        fields = [bytes(names.data[i : i + name_length]) for i in range(0, len(names.data), name_length)]
        keys = [field.partition(b"\0")[0].decode("latin-1") for field in fields]
        field_values = [_read_value(part, order, depth) for part in _take(count * len(keys), parts)]
        rows = [field_values[i : i + len(keys)] for i in range(0, len(field_values), max(1, len(keys)))]
        return name, [dict(zip(keys, row, strict=True)) for row in rows]
    return name, None


def _read_value(element: _Element, order: _Bytes, depth: int) -> Any:
    if element.kind != _MATRIX:
        raise _Damaged(f"it is damaged: a field is of the type {element.kind}")
    return _read_matrix(element.data, order, depth + 1)[1]


def _take(count: int, parts: Iterator[_Element]) -> list[_Element]:
    values = list(parts)
    if len(values) != count:
        raise _Damaged(f"it is damaged: expected a list of length {count}, got {len(values)}")
    return values


def _read_flags(element: _Element | None, order: _Bytes) -> int:
    """The class of an array and its flags."""
    return next(iter(_read_integers(element, order)), 0)


def _read_integers(element: _Element | None, order: _Bytes) -> list[int]:
    numbers = _read_numbers(element, order)
    if not np.isfinite(numbers).all():
        raise _Damaged("it is damaged: expected integers")
    return [int(number) for number in numbers]


def _read_numbers(element: _Element | None, order: _Bytes) -> NDArray[np.float64]:
    code = None if element is None else _NUMBERS.get(element.kind)
    if element is None or code is None or len(element.data) % int(code[1]):
        raise _Damaged("it is damaged: expected numbers")
    return np.frombuffer(element.data, order.order + code).astype(np.float64)


def _read_text(element: _Element | None, order: _Bytes) -> str:
    encoding = None if element is None else _TEXTS.get(element.kind)
    if element is None or encoding is None:
        raise _Damaged("it is damaged: expected text")
    wide = {"<": "-le", ">": "-be"}[order.order] if encoding in ("utf-16", "utf-32") else ""
    return bytes(element.data).decode(encoding + wide, errors="replace")
