"""Our .npz archives.  Nothing in them is ever unpickled, so no code in them is ever run."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..runtime.text import one_line
from .files import check_file, replacing

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Account = TypeVar("Account", bound=DataclassInstance)

MAX_BYTES = 2**28  # that an archive may unpack to: a descriptor of 138 megapixels with 31 channels and cells of 8
VARIABLE = "NABLAHOG_MAX_BYTES"
MAX_CHARACTERS = 2**22  # of a text; parsed JSON may take thirty times as many bytes


def max_bytes() -> int:
    """The bytes that an archive may unpack to: the environment variable ``NABLAHOG_MAX_BYTES``, or MAX_BYTES.

    Raises:
        ValueError: the variable is no positive number.
    """
    given = os.environ.get(VARIABLE) or str(MAX_BYTES)
    if not given.isdecimal() or int(given) < 1:
        raise ValueError(f"{VARIABLE} must be a number of bytes, got {one_line(given)!r}")
    return int(given)


def check_size(path: str | os.PathLike[str], size: int) -> None:
    """Raises ValueError if a file unpacks to more bytes than :func:`max_bytes`."""
    if size > max_bytes():
        raise ValueError(
            f"{path}: the file unpacks to {size:,} bytes, more than the {max_bytes():,} allowed; the environment "
            f"variable {VARIABLE} allows more"
        )


def read_arrays(path: str | os.PathLike[str], kind: str, names: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """The arrays ``names`` of the archive ``path``.

    Args:
        path: the file.
        kind: what it is expected to be, such as "descriptor file", for the messages.
        names: of the arrays that it must have; others are not read.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no archive, is damaged, lacks an array, holds pickled objects, or unpacks to more than
            :func:`max_bytes`.
    """
    with _opened(path, kind) as archive:
        missing = [name for name in names if name not in archive]
        arrays = {} if missing else {name: archive[name] for name in names}
    if missing:
        raise ValueError(f"{path}: expected a {kind}, but the archive lacks {', '.join(missing)}")
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # a member that is no .npy file is read as bytes
            raise ValueError(f"{path}: expected a {kind}, but {name} in the archive is no array (.npy)")
    return arrays


def names_in(path: str | os.PathLike[str], kind: str) -> list[str]:
    """The names of the arrays of the archive ``path``, none of which is read.

    Raises:
        FileNotFoundError, ValueError: as :func:`read_arrays`.
    """
    with _opened(path, kind) as archive:
        return list(archive)


def numbers_in(path: str | os.PathLike[str], kind: str) -> dict[str, NDArray[np.generic]]:
    """All arrays of numbers of the archive ``path``; other entries are skipped.

    Raises:
        FileNotFoundError, ValueError: as :func:`read_arrays`, but for pickled objects.
    """
    with _opened(path, kind) as archive:
        arrays = {name: _unless_pickled(archive, name) for name in archive}
    return {name: array for name, array in arrays.items() if array is not None and array.dtype.kind in "biufc"}


def _unless_pickled(archive: np.lib.npyio.NpzFile, name: str) -> NDArray[np.generic] | None:
    try:
        array = archive[name]
    except ValueError as error:
        if "allow_pickle" in str(error):
            return None
        raise
    return array if isinstance(array, np.ndarray) else None  # a member that is no .npy file is read as bytes


@contextmanager
def _opened(path: str | os.PathLike[str], kind: str) -> Iterator[np.lib.npyio.NpzFile]:
    path = Path(path)
    check_file(path, f"a {kind} (.npz)")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
    except Exception as error:  # zipfile has no common base for what damage makes it raise
        raise ValueError(f"{path}: expected a {kind} (.npz), but it cannot be read: {one_line(error)}") from None
    check_size(path, size)
    try:
        # opened here, because numpy leaves damaged files open
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as arrays:
            yield arrays
    except Exception as error:  # a damaged archive fails in zipfile, zlib or numpy, each with its own kinds of error
        if "allow_pickle" in str(error):
            raise ValueError(f"{path}: the archive holds pickled objects, which are never loaded") from None
        raise ValueError(f"{path}: the archive is damaged: {one_line(error)}") from None


def text(arrays: dict[str, NDArray[np.generic]], name: str) -> str:
    """The string that the array ``name`` holds.

    Raises:
        ValueError: it holds none, or one of more than :data:`MAX_CHARACTERS`.
    """
    array = arrays[name]
    if array.shape != () or array.dtype.kind != "U":
        raise ValueError(f"{name} must be one string, got {array.dtype} of shape {array.shape}")
    if array.itemsize > 4 * MAX_CHARACTERS:
        raise ValueError(f"{name} must be a string of at most {MAX_CHARACTERS:,} characters")
    return str(array.item())


def check_format(arrays: dict[str, NDArray[np.generic]], kind: str, expected: int) -> None:
    """Raises ValueError unless the array ``format`` is the version ``expected``."""
    version = arrays["format"]
    if version.shape != () or version.item() != expected:
        raise ValueError(f"this version reads {kind}s of format {expected}, got {one_line(version)}")


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turns errors in the block into a ValueError that begins with the name of the file."""
    try:
        yield
    except (TypeError, ValueError, RuntimeError, OverflowError, RecursionError) as error:
        raise ValueError(f"{os.fspath(path)}: {one_line(error)}") from None


def write_arrays(
    path: str | os.PathLike[str], version: int, arrays: Mapping[str, object], *, compressed: bool = False
) -> None:
    """Writes an archive of ``arrays`` and, as ``format``, its version.  The file is replaced whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    with replacing(path) as file:
        named = {name: np.asarray(array) for name, array in {"format": version, **arrays}.items()}
        (np.savez_compressed if compressed else np.savez)(file, **named)  # type: ignore[arg-type]


def account_to_text(account: DataclassInstance) -> str:
    """A dataclass of texts, numbers and tuples of these, as JSON."""
    return json.dumps(asdict(account))


def account_of(kind: type[Account], of: str) -> Account:
    """Reads what :func:`account_to_text` wrote, also by a version in which the dataclass lacked fields with defaults.

    Raises:
        ValueError: it wrote something else.
    """
    try:
        stored = json.loads(of)
        left_out = {field.name for field in fields(kind) if field.default is not MISSING} - stored.keys()
        hints = get_type_hints(kind).items()
        return kind(**{name: _as(hint, stored[name]) for name, hint in hints if name not in left_out})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"its account of the learning cannot be read: {one_line(error)}") from None


def _as(hint: Any, value: Any) -> Any:
    return tuple(map(get_args(hint)[0], value)) if get_origin(hint) is tuple else hint(value)
