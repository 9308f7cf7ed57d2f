"""The table: a row makes an input, a column takes it, and a cell is their result.

A cell is *equal* to the result of the same input in its plainest form, or *refused* by an error of the package that
says what to write.  Anything else fails: another result, another exception, a warning that nobody asked for.
"""

from __future__ import annotations

import linecache
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from traceback import walk_tb
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

import nablahog

PACKAGE = Path(nablahog.__file__).parent
Kind: TypeAlias = Literal[
    "image", "batch", "descriptor", "size", "box", "angle", "number", "camera", "mask", "mesh", "name", "context"
]
State: TypeAlias = Literal["equal", "refused", "failing", "none"]
LONGEST = 900  # characters of a sentence
REMEDY = re.compile(
    r"must|expected|should|write|save|pass |give|need|use |one of|divide|convert|specify|choose|there are|"
    r"has (the )?shape",
    re.IGNORECASE,
)


class NotApplicable(Exception):
    """The column has no place for this value, as a file has none for a tensor."""


class Told(Exception):
    """The sentence with which the command or the page refuses."""


def same(value: Any) -> Any:
    return value


@dataclass(frozen=True)
class Row:
    """A kind of input.

    Attributes:
        name: of the row.
        kind: which columns take it.
        make: from the plain input of a column to this one; of a context, from a call to its result.
        means: from the plain input to another plain one of the same meaning, where that is not the plain input itself.
        must: ``"be taken"``: any function that takes this kind has to take it; ``"be taken if traceable"``: any that
            is made of tensors; ``"be refused"``: it has no meaning;
            ``"either"``: equal, or refused with a remedy.
        tolerance: of the result, beside that of the column.
        warns: whether a warning of the package that says what to write is as good as a refusal.
        leaves_out: columns to which it does not apply, each with the reason.
    """

    name: str
    kind: Kind
    make: Callable[[Any], Any]
    means: Callable[[Any], Any] = same
    must: Literal["be taken", "be taken if traceable", "be refused", "either"] = "either"
    tolerance: float = 0.0
    warns: bool = False
    leaves_out: Mapping[str, str] = field(default_factory=dict)


def rows(kind: Kind, makes: Mapping[str, Callable[[Any], Any]], *, prefix: str = "", **more: Any) -> list[Row]:
    """A row for each way to make an input, with what they have in common."""
    return [Row(f"{prefix or kind} {name}", kind, make, **more) for name, make in makes.items()]


class Use(NamedTuple):
    """How a column takes a kind of input: its function, the plain input, and how an input's meaning is written."""

    call: Callable[[Any], Any]
    base: Any
    plain: Callable[[Any], Any] = same


@dataclass(frozen=True)
class Column:
    """An entry point.

    Attributes:
        name: of the column.
        uses: by kind of input; contexts go around that of the kind ``"context"``, or else around the first one.
        tolerance: absolute, of its results.
        traceable: whether it is made of tensors throughout, so that PyTorch compiles and exports it.
        types: of images, batches, descriptors and masks that it is for; others it may refuse; any input if there are
            none, as the library may whose names it has.
    """

    name: str
    uses: Mapping[Kind, Use]
    tolerance: float = 1e-6
    traceable: bool = False
    types: tuple[type, ...] = (object,)

    def use(self, kind: Kind) -> Use:
        return self.uses.get(kind) or next(iter(self.uses.values()))

    def is_for(self, kind: Kind, value: Any) -> bool:
        if not self.types:
            return False
        return kind not in ("image", "batch", "descriptor", "mask") or isinstance(value, self.types)

    def takes(self, row: Row) -> bool:
        return (row.kind == "context" or row.kind in self.uses) and self.name not in row.leaves_out


def column(name: str, /, **more: Any) -> Column:
    """A column of which the uses are named by their kinds, among the other attributes."""
    uses = {key: use for key, use in more.items() if isinstance(use, Use)}
    return Column(name, uses, **{key: value for key, value in more.items() if key not in uses})  # type: ignore[arg-type]


class Cell(NamedTuple):
    state: State
    detail: str = ""
    where: str = ""  # file and line in the package


def run_cell(row: Row, column: Column) -> Cell:
    """What the column does with the row's input."""
    use = column.use(row.kind)
    try:
        expected = _expected(row, column, use)
    except NotApplicable:
        return Cell("none")
    except Exception as error:  # its meaning has no result: the column has to refuse it
        expected = error
    torch.manual_seed(0)
    context, value = row.kind == "context", None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            value = row.make(Call(column, lambda: use.call(use.plain(use.base)), use) if context else use.base)
            result = numbers(value if context else use.call(value))
    except NotApplicable:
        return Cell("none")
    except Exception as error:
        must_take = column.traceable if row.must == "be taken if traceable" else column.is_for(row.kind, value)
        return _judge_error(error, must_take=row.must.startswith("be taken") and must_take, warns=row.warns)
    if row.must == "be refused" or isinstance(expected, Exception):
        return Cell("failing", "taken, though it has no meaning")
    return _judge_result(result, expected, column.tolerance + row.tolerance)


def _expected(row: Row, column: Column, use: Use) -> NDArray[np.float64]:
    if row.means is same:
        return numbers(plain_result(column.name, row.kind))
    torch.manual_seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return numbers(use.call(use.plain(row.means(use.base))))


class Call(NamedTuple):
    """What a context is put around."""

    column: Column
    run: Callable[[], Any]
    use: Use


@cache
def plain_result(name: str, kind: Kind) -> Any:
    """The result of a column for its plain input, computed once."""
    from .columns import COLUMNS

    use = COLUMNS[name].use(kind)
    torch.manual_seed(0)
    return use.call(use.plain(use.base))


def numbers(result: Any) -> NDArray[np.float64]:
    """All numbers of a result in a row."""
    if isinstance(result, torch.Tensor):
        return np.array(result.detach().tolist(), np.float64).ravel()  # also in torch.func.grad
    if is_dataclass(result):
        result = [getattr(result, each.name) for each in fields(result)]
    if isinstance(result, Mapping):
        result = list(result.values())
    if isinstance(result, list | tuple):
        return np.concatenate([np.zeros(0), *map(numbers, result)])
    return np.asarray(result, dtype=np.float64).ravel()


def _judge_result(result: NDArray[np.float64], expected: NDArray[np.float64], tolerance: float) -> Cell:
    if result.shape != expected.shape:
        return Cell("failing", f"{result.size} numbers instead of {expected.size}")
    if not np.allclose(result, expected, rtol=0, atol=tolerance, equal_nan=True):
        return Cell("failing", f"another result, by {np.nanmax(np.abs(result - expected), initial=0):.3g}")
    return Cell("equal")


def _judge_error(error: Exception, *, must_take: bool, warns: bool) -> Cell:
    sentence, where, ours = str(error), place(error), is_ours(error)
    detail = f"{type(error).__name__}: {sentence.splitlines()[0] if sentence else ''}"
    if not ours:
        return Cell("failing", detail, where)
    if isinstance(error, Warning) and not warns:
        return Cell("failing", f"warned: {detail}", where)
    if must_take:
        return Cell("failing", f"refused, though it can be taken: {detail}", where)
    if "\n" in sentence.strip() or len(sentence) > LONGEST or not REMEDY.search(sentence):
        return Cell("failing", f"refused without a remedy: {detail}", where)
    return Cell("refused", detail, where)


def is_ours(error: Exception) -> bool:
    """Whether the package itself raised it: an error of its kinds, or its warning, from a statement that raises it."""
    if isinstance(error, Told):
        return not re.search("Traceback|an error in the program", str(error))
    frames = [(frame.f_code.co_filename, line) for frame, line in walk_tb(error.__traceback__)]
    file, line = frames[-1]
    if not isinstance(error, ValueError | TypeError | OSError | UserWarning) or not file.startswith(str(PACKAGE)):
        return False
    return linecache.getline(file, line).strip().startswith(("raise", "warnings.warn"))


def place(error: Exception) -> str:
    """The last line of the package on the way to an error."""
    inside = [
        f"{Path(frame.f_code.co_filename).relative_to(PACKAGE)}:{line}"
        for frame, line in walk_tb(error.__traceback__)
        if frame.f_code.co_filename.startswith(str(PACKAGE))
    ]
    return inside[-1] if inside else ""
