"""Arrays in files: our .npz archives, and the .npy, .npz and .mat files of other programs.

Nothing in them is ever unpickled, so no code in them is ever run.
"""

from __future__ import annotations

import os
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.errors import InputError
from ..runtime.text import one_line
from .files import Writable, replacing
from .input_file import InputFile, Readable, input_file

PICKLED = (
    "pickled objects, which are never loaded: write numbers, as array.astype(float) makes of numbers, and "
    "numpy.stack(array) of vectors"
)
MAX_ARCHIVE_BYTES = (
    2**28
)  # that an archive may unpack to: a descriptor of 138 megapixels with 31 channels and cells of 8
LIMIT_VARIABLE = "NABLAHOG_MAX_BYTES"
PICKLE_ENDINGS = (".joblib", ".pkl", ".pickle")
PICKLE_STARTS = tuple(bytes([0x80, protocol]) for protocol in range(2, 6))
MAX_CHARACTERS = 2**22  # of a text; parsed JSON may take thirty times as many bytes

Arrays = dict[str, NDArray[Any]]


def read_arrays(path: Readable, kind: str, names: Sequence[str]) -> Arrays:
    """The arrays ``names`` of the archive ``path``, of a ``kind`` such as "descriptor file"; others are not read.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not an archive, is damaged, lacks an array, holds pickled objects, or is larger unpacked than
            :data:`MAX_ARCHIVE_BYTES`, or than the environment variable ``NABLAHOG_MAX_BYTES`` says.
    """
    with _open_archive(input_file(path), kind) as archive:
        missing = [name for name in names if name not in archive]
        arrays = {} if missing else {name: archive[name] for name in names}
    if missing:
        raise ValueError(f"{path}: expected a {kind}, but the archive lacks {', '.join(missing)}")
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # a member that is no .npy file is read as bytes
            raise ValueError(f"{path}: expected a {kind}, but {name} in the archive is not an array (.npy)")
        if array.dtype.kind == "U" and not _is_unicode(array):
            raise ValueError(f"{path}: the archive is damaged: {name} holds characters that Unicode lacks")
    return arrays


def _is_unicode(array: NDArray[np.str_]) -> bool:
    """Whether texts can be Python's, which fails later, and anywhere, of those that NumPy takes from a file."""
    numbers = np.frombuffer(array.tobytes(), np.dtype(np.uint32).newbyteorder(array.dtype.byteorder))
    return not len(numbers) or int(numbers.max()) <= sys.maxunicode


def write_arrays(path: Writable, version: int, arrays: Mapping[str, object], *, compressed: bool = False) -> None:
    """Writes an archive of ``arrays`` and, as ``format``, its version.  The file is replaced whole or not at all."""
    with replacing(path) as file:
        named = {name: np.asarray(array) for name, array in {"format": version, **arrays}.items()}
        (np.savez_compressed if compressed else np.savez)(file, **named)  # type: ignore[arg-type]


def read_text(arrays: Arrays, name: str) -> str:
    """The string that an array holds; ValueError if it holds none, or more than :data:`MAX_CHARACTERS`."""
    array = arrays[name]
    if array.shape != () or array.dtype.kind != "U":
        raise ValueError(f"{name} must be one string, got {array.dtype} of shape {array.shape}")
    if array.itemsize > 4 * MAX_CHARACTERS:
        raise ValueError(f"{name} must be a string of at most {MAX_CHARACTERS:,} characters, got one that is longer")
    return str(array.item())


def check_format(arrays: Arrays, kind: str, expected: int) -> None:
    """Raises ValueError unless the array ``format`` is the version ``expected``."""
    version = arrays["format"]
    if version.shape != () or version.item() != expected:
        raise ValueError(f"this version reads {kind}s of format {expected}, got {one_line(version)}")


@contextmanager
def naming(path: Readable) -> Iterator[None]:
    """Turns errors in the block into a ValueError that begins with the name of the file."""
    try:
        yield
    except InputError as error:
        raise error.reworded(f"{path}: {error}") from None
    except (TypeError, ValueError, RuntimeError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path}: {one_line(error)}") from None


def is_archive(path: Readable) -> bool:
    """Whether ``path`` claims to be an archive: it is named .npz, or starts as a zip archive does."""
    return input_file(path).starts_as(".npz", b"PK\x03\x04")


def is_raw(path: Readable) -> bool:
    """Whether ``path`` is, by its name or its first bytes, a .npy or .mat file, or an .npz file that is not ours."""
    file = input_file(path)
    if _is_npy(file) or _is_mat(file):
        return True
    if not is_archive(file):
        return False
    try:
        with _open_archive(file, "descriptor file") as archive:
            return "spec" not in archive
    except (OSError, ValueError):  # damaged; reading it as a descriptor file will say so
        return False


def refuse_pickle(path: Readable) -> None:
    """Raises ValueError, with the line that saves its numbers, if ``path`` is a file of pickle or joblib."""
    file = input_file(path)
    if file.ending not in PICKLE_ENDINGS and not any(file.starts_as(".pkl", start) for start in PICKLE_STARTS):
        return
    file.check("an array (.npy)")
    name = one_line(repr(os.path.basename(file.name)))
    load = f"joblib.load({name})" if file.ending == ".joblib" else f"pickle.load(open({name}, 'rb'))"
    module = load.partition(".")[0]
    raise ValueError(
        f"{file}: a pickle is never loaded, because loading runs code. Where you trust it, this writes a classifier's "
        f"weights: import {module}, numpy; numpy.save('weights.npy', {load}.coef_); write [-1].coef_ for a pipeline, "
        "and nothing after the bracket for an array"
    )


def read_array(path: Readable, key: str | None) -> NDArray[np.floating]:
    """The array of a .npy, .npz or .mat file: of several, that named ``key``, or the only one of more than one number.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, has no such array or several, or one of no floating-point numbers.
    """
    array = _choose_array(input_file(path), key)
    if array.dtype.kind != "f" or array.dtype.itemsize > 8:
        write = ": write array.astype(float)" if array.dtype.kind in "biuf" else ""
        write = "; if it is an image, save it as PNG" if array.dtype == np.uint8 else write
        raise ValueError(f"{path}: expected a descriptor of float16, float32 or float64, got {array.dtype}{write}")
    if not array.size:
        raise ValueError(f"{path}: expected a descriptor, got an array without numbers, of shape {array.shape}")
    return array


def _choose_array(file: InputFile, key: str | None) -> NDArray[Any]:
    if _is_npy(file):
        if key is not None:
            raise ValueError(f"{file}: a .npy file holds one array, which has no name, got the name {one_line(key)!r}")
        return _read_npy(file)
    if _is_mat(file):
        from .matfile import read_mat_arrays  # which models and descriptor files do not need

        arrays = read_mat_arrays(file)
    else:
        arrays = read_number_arrays(file)
    if key is not None and key in arrays:
        return arrays[key]
    if not arrays:
        remedy = ""
        if _is_pytorch(file):
            remedy = "; it is PyTorch's: write numpy.save('descriptor.npy', tensor.numpy()) in place of torch.save"
        raise ValueError(f"{file}: expected an array, but the file holds no array of numbers{remedy}")
    listed = one_line("the file holds " + ", ".join(f"{name} {array.shape}" for name, array in arrays.items()))
    names = {"keys": [*arrays]}
    if key is not None:
        raise InputError(f"{file}: there is no array {one_line(key)!r} of numbers; {listed}", "array", names)
    several = [array for array in arrays.values() if array.size > 1]
    if len(several) != 1:
        raise InputError(f"{file}: expected one array, but {listed}", "array", names)
    return several[0]


def read_number_arrays(path: Readable) -> Arrays:
    """All arrays of numbers of an archive; texts, pickled objects and what is not an array are passed over."""

    def unless_pickled(archive: np.lib.npyio.NpzFile, name: str) -> Any:
        try:
            return archive[name]
        except ValueError as error:
            if "allow_pickle" in str(error):
                return None
            raise

    with _open_archive(input_file(path), "archive of arrays") as archive:
        arrays = {name: unless_pickled(archive, name) for name in archive}
    return {
        name: array for name, array in arrays.items() if isinstance(array, np.ndarray) and array.dtype.kind in "biufc"
    }


@contextmanager
def _open_archive(file: InputFile, kind: str) -> Iterator[np.lib.npyio.NpzFile]:
    file.check(f"a {kind} (.npz)")
    try:
        with file.open() as stream, zipfile.ZipFile(stream) as archive:
            size = sum(member.file_size for member in archive.infolist())
    except Exception as error:  # zipfile has no common base for what damage makes it raise
        raise ValueError(f"{file}: expected a {kind} (.npz), but it cannot be read: {one_line(error)}") from None
    _check_size(file, size)
    try:
        # opened here, because numpy leaves damaged files open
        with file.open() as stream, np.load(stream, allow_pickle=False) as arrays:
            yield arrays
    except Exception as error:  # a damaged archive fails in zipfile, zlib or numpy, each with its own kinds of error
        if "allow_pickle" in str(error):
            raise ValueError(f"{file}: the archive holds {PICKLED}") from None
        raise ValueError(f"{file}: the archive is damaged: {one_line(error)}") from None


def _check_size(file: InputFile, size: int) -> None:
    allowed = os.environ.get(LIMIT_VARIABLE) or str(MAX_ARCHIVE_BYTES)
    if not allowed.isdecimal() or int(allowed) < 1:
        raise ValueError(f"{LIMIT_VARIABLE} must be a number of bytes, got {one_line(allowed)!r}")
    if size > int(allowed):
        raise ValueError(
            f"{file}: the file unpacks to {size:,} bytes, more than the {int(allowed):,} allowed; the environment "
            f"variable {LIMIT_VARIABLE} allows more"
        )


def _read_npy(file: InputFile) -> NDArray[Any]:
    file.check("an array (.npy)")
    _check_size(file, file.size)
    try:
        with file.open() as stream:
            version = np.lib.format.read_magic(stream)
            read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
            shape, by_columns, dtype = read_header[version](stream)
            if dtype.hasobject:
                raise ValueError("Python objects")
            # not np.load, which allocates whatever a damaged header claims
            array = np.ndarray(shape, dtype, stream.read(), order="F" if by_columns else "C")
        return np.array(array) if dtype.kind == "f" else array  # copying 10¹² items of 0 bytes takes forever
    except Exception as error:  # a damaged header fails in many ways
        if "Python objects" in str(error):
            raise ValueError(f"{file}: the file holds {PICKLED}") from None
        raise ValueError(f"{file}: expected an array (.npy), but it cannot be read: {one_line(error)}") from None


def _is_pytorch(file: InputFile) -> bool:
    """Whether an archive is what ``torch.save`` writes: tensors that pickled objects refer to."""
    with suppress(zipfile.BadZipFile), file.open() as stream, zipfile.ZipFile(stream) as archive:
        return any(name.endswith("/data.pkl") for name in archive.namelist())
    return False


def _is_npy(file: InputFile) -> bool:
    return file.starts_as(".npy", b"\x93NUMPY")


def _is_mat(file: InputFile) -> bool:
    return file.starts_as(".mat", b"MATLAB")
