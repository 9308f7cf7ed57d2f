"""Texts of mesh files as all readers take them, and their limits."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..runtime.text import decode_text

Number = TypeVar("Number", np.float64, np.int64)

MAX_MESH_BYTES = 2**30  # more than a text file of MAX_FACES has
MAX_FACES = 5_000_000

_WINDOWS_NAN = re.compile(rb"-?(?:\b1\.#(?:IND|QNAN|SNAN|INF)\w*|\bnan\((?:ind|snan)?\))", re.IGNORECASE)

_REMARK = re.compile(rb"(?m)(?:^ *#| # )[^\n]*")  # but no "Material #25"


def as_utf8(text: bytes) -> bytes:
    """``text`` in UTF-8, without a mark, and with "nan" for what old programs of Windows write in its place.

    What is no Unicode is taken for Latin-1: remarks may have any encoding.
    """
    try:
        plain = decode_text(text).encode()
    except UnicodeDecodeError:
        plain = text.decode("latin-1").encode()
    return _WINDOWS_NAN.sub(b"nan", plain) if b"1.#" in plain or b"(" in plain else plain


def as_lines(text: bytes) -> list[bytes]:
    """The lines of a text in UTF-8 that are not empty, without tabs and blanks at their ends.

    Those that a backslash continues are one.
    """
    plain = as_utf8(text).replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ")
    if b"\\" in plain:
        plain = re.sub(rb"\\ *\n", b" ", _REMARK.sub(b"", plain))  # a remark is not continued
    return [line.strip() for line in plain.split(b"\n") if line]


def as_numbers(text: bytes, kind: type[Number], count: int, expected: str) -> NDArray[Number]:
    """The ``count`` numbers of a text, with blanks between them; ValueError says what was ``expected``."""
    numbers: NDArray[Number] = np.empty(0, kind)
    with suppress(ValueError):  # older versions of NumPy return the numbers before what is none
        numbers = np.fromstring(text, kind, sep=" ")
    if numbers.size != count:
        raise ValueError(expected)
    return numbers
