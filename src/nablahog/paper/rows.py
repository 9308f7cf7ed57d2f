"""Tables in CSV files, row by row."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..io.files import check_file
from ..runtime.text import one_line

MAX_BYTES = 2**28  # of a file


@dataclass(frozen=True)
class Row:
    """A row of a table, or an entry of another list.

    Attributes:
        where: it is, for messages.
        values: by column.
        decimal: the character between whole numbers and fractions.
    """

    where: str
    values: Mapping[str, object]
    decimal: str = "."

    def error(self, column: str, message: str) -> ValueError:
        """What to raise about the value of a column."""
        return ValueError(f"{self.where}, column {column}: {message}")

    def text(self, column: str) -> str:
        """The text of a column without blanks around it; empty if there is none."""
        value = self.values.get(column)
        return value.strip() if isinstance(value, str) else ""

    def number(self, column: str, unit: str) -> float:
        """The number in a column.

        Raises:
            ValueError: it is no finite number.
        """
        value = self.values.get(column)
        try:
            written = value.replace(self.decimal, ".") if isinstance(value, str) else value
            number = math.nan if isinstance(value, bool) else float(written)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise self.error(column, f"expected a finite number of {unit}, got {one_line(repr(value), 60)}")
        return number

    def numbers(self, columns: Sequence[str], unit: str) -> list[float] | None:
        """The numbers in some columns; None if all of them are empty.

        Raises:
            ValueError: only some are empty, or one is no finite number.
        """
        if all(str(self.values.get(column) or "").strip() == "" and self.values.get(column) != 0 for column in columns):
            return None
        return [self.number(column, unit) for column in columns]


def read_list(path: Path, expected: str) -> bytes:
    """The bytes of a file, at most :data:`MAX_BYTES`.

    Raises:
        FileNotFoundError, ValueError: there is no such file, it is none, or it has more.
    """
    check_file(path, expected)
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: a list of more than {MAX_BYTES:,} bytes is refused")
    return path.read_bytes()


def read_csv(path: str | os.PathLike[str], required: Sequence[str]) -> list[Row]:
    """The rows below the line of column names, empty ones left out.

    Args:
        path: a file in UTF-8, with or without a byte order mark.  Its columns are divided by commas; or by semicolons,
            and then numbers may have a decimal comma.
        required: columns that it must have; further ones may stand anywhere.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it has more than :data:`MAX_BYTES`, is no such file, lacks a column, or has no row.
    """
    path = Path(path)
    line, data = 1, read_list(path, "a CSV file")
    try:
        written = io.TextIOWrapper(io.BytesIO(data), "utf-8-sig").read()
        heads = written.partition("\n")[0]
        semicolons = heads.count(";") > heads.count(",")
        reader = csv.DictReader(io.StringIO(written), delimiter=";" if semicolons else ",", skipinitialspace=True)
        reader.fieldnames = [name.strip() for name in reader.fieldnames or ()]
        missing = [name for name in required if name not in reader.fieldnames]
        if missing:
            raise ValueError(f"expected the columns {', '.join(required)}, but {' and '.join(missing)} is missing")
        rows = []
        for values in reader:
            line = reader.line_num
            rows.append(Row(f"{path}, line {line}", values, "," if semicolons else "."))
    except (ValueError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
        raise ValueError(f"{path}, line {line}: {one_line(error)}") from None
    if not rows:
        raise ValueError(f"{path}: expected at least one row below the names of the columns, got none")
    return rows
