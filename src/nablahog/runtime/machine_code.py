"""Machine code on disk: what is damaged, or may be somebody else's, is never loaded.

Machine code is stored as pickles of object files.  Reading one runs code: a flipped bit can end the process, whoever
writes the file may do anything.  So each file begins with a digest, which is compared before the rest is unpickled.  It
tells damage only; against other users, folder and files belong to this one, and nobody else may write them.

A wheel may bring machine code beside the Python files, made for a level of processors.  It is trusted as they are.
"""

from __future__ import annotations

import hashlib
import logging
import multiprocessing
import os
import pickle
import platform
import secrets
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core import config, types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from .cache_folder import VARIABLE, cache_folder
from .processor import LEVELS, Level, level

KEY, DIGEST = 16, 32  # bytes
CODE, PART = ".code", ".part"
DAY = 86400.0
UNUSED = 60 * DAY  # seconds after which a file is removed
# of what the code calls at run time, and of the bytecode that it was made from
_VERSIONS = (numba.__version__, llvmlite.__version__, str(sys.implementation.cache_tag), getattr(sys, "abiflags", ""))
SHIPPED = Path(__file__).parents[1] / "machine_code"
_log = logging.getLogger(__name__)
_rebuild: Any = CompileResult._rebuild
_dumps: Any = dumps


class CodeCache(NullCache):
    """The machine code of one function, for each signature and processor in a file of its own.

    Args:
        name: of the function, for people who look into the folder.
        identity: of its code: all that the machine code depends on beside signature, processor and versions.
    """

    def __init__(self, name: str, identity: str) -> None:
        self.name, self.identity, self._began = name, identity, 0.0

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function; None if it is not on disk, or damaged, and numba has to compile it."""
        target.refresh()
        folder = code_folder()
        for payload in self._payloads(signature, target.codegen(), folder):
            with suppress(Exception):  # of a numba that was changed by hand; unpickling raises nearly anything
                return _rebuild(target, *pickle.loads(payload))
        _tell_that_it_compiles(folder)
        self._began = time.perf_counter()
        return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Stores the compiled function, if that can be done."""
        _log.info("compiled %s in %.1f s", self.name, time.perf_counter() - self._began)
        folder = code_folder()
        if folder is None or compiled.library.has_dynamic_globals:
            return
        key = self._key(signature, _processor(compiled.codegen))
        payload: bytes = _dumps(compiled._reduce())
        try:
            _write(self._path(folder, key), _digest(payload, key) + payload)
            _tidy(folder)
        except OSError as error:  # a full disk, say: the code is in memory
            _warn_that_nothing_is_kept(f"{folder}: {error.strerror}")

    def _payloads(self, signature: Any, codegen: Any, folder: Path | None) -> Iterator[bytes]:
        """What there is on disk: made for this very processor, then for its level."""
        own = self._key(signature, _processor(codegen))
        if folder is not None and (payload := _read(self._path(folder, own), own)):
            yield payload
        general = level()
        if general is not None:
            key = self._key(signature, _of_level(general))
            if folder is not None and (payload := _read(self._path(folder, key), key)):
                yield payload
            if payload := _verified(self._path(SHIPPED, key), key):
                yield payload

    def _key(self, signature: Any, processor: str) -> bytes:
        facts = [self.identity, *map(_described, signature), processor, *_VERSIONS]
        return hashlib.blake2b("\n".join(facts).encode(), digest_size=KEY).digest()

    def _path(self, folder: Path, key: bytes) -> Path:
        return folder / f"{self.name}-{key.hex()}{CODE}"


@cache
def _tell_that_it_compiles(folder: Path | None) -> None:
    """Once a process."""
    if folder is not None:
        _log.info("compiling loops for this processor, once; some take seconds. They are kept in %s", folder)


@cache
def _warn_that_nothing_is_kept(reasons: str) -> None:
    """Once a process, and not in each of many workers."""
    if multiprocessing.parent_process() is None:
        _log.warning(
            "each process compiles its loops anew, for some seconds each, as they cannot be kept (%s). Set %s to a "
            "folder that you may write, in a container one of the image or of a volume; `nablahog warmup` fills it",
            reasons,
            VARIABLE,
        )


def _processor(codegen: Any) -> str:
    """What numba compiles for."""
    triple, name, features = codegen.magic_tuple()
    for each in LEVELS:
        if (name, features) == (each.name, each.flags):
            return _of_level(each)
    return f"{triple}\n{name}\n{features}"


def _of_level(general: Level) -> str:
    return f"{sys.platform} {platform.machine()} {general.name}"


def _described(kind: Any) -> str:
    """A type of an argument; of tuples with names, the positions of the fields too."""
    if not isinstance(kind, types.BaseTuple):
        return str(kind)
    elements: Any = kind
    of, fields = getattr(kind, "instance_class", tuple), ", ".join(map(_described, elements))
    return f"{of.__module__}.{of.__qualname__}{getattr(of, '_fields', '')}({fields})"


def _digest(payload: bytes, key: bytes) -> bytes:
    return hashlib.blake2b(payload, digest_size=DIGEST, key=key).digest()


def _read(path: Path, key: bytes) -> bytes | None:
    """The contents of a file; None if it is missing, damaged, of another key, or not of this user alone."""
    try:
        state = path.lstat()
        if not stat.S_ISREG(state.st_mode) or not _only_ours(state):
            return None
    except OSError:
        return None
    payload = _verified(path, key)
    if payload is not None and time.time() - state.st_mtime > DAY:
        with suppress(OSError):
            os.utime(path)  # it is in use
    return payload


def _verified(path: Path, key: bytes) -> bytes | None:
    """The contents of a file; None if it is missing, damaged or of another key."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    payload = data[DIGEST:]
    return payload if data[:DIGEST] == _digest(payload, key) else None


def _write(path: Path, data: bytes) -> None:
    """Writes a file whole or not at all, for the user alone whatever the umask.

    Raises:
        OSError: it cannot be written.
    """
    part = path.with_name(f"{secrets.token_hex(16)}{PART}")
    file = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
    try:
        with open(file, "wb") as opened:
            opened.write(data)
        part.chmod(0o600)
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


@cache
def _tidy(folder: Path) -> None:
    """Removes files that nobody has used for long, once a process."""
    now = time.time()
    for file in folder.iterdir():
        age = {CODE: UNUSED, PART: DAY}.get(file.suffix)
        with suppress(OSError):
            if age is not None and now - file.stat().st_mtime > age:
                file.unlink()


@cache
def code_folder() -> Path | None:
    """The folder for machine code, made if missing; None if there is none, which the log tells.

    It is ``machine-code`` in the folder that ``NABLAHOG_CACHE_DIR`` names.  Without that variable it is the first of
    these that can be made and that nobody else owns or may write: ``nablahog/machine-code`` where numba's own
    ``NUMBA_CACHE_DIR`` says, ``machine-code`` in the user's folder for caches, and in ``__pycache__`` of this package.
    """
    reasons = []
    for path in _candidates():
        reason = _made(path)
        if reason is None:
            return path
        reasons.append(f"{path}: {reason}")
    _warn_that_nothing_is_kept("; ".join(reasons))
    return None


def _made(path: Path) -> str | None:
    """Makes a folder for this user alone.  Returns why it cannot be used, None if it can."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            path.mkdir(0o700)
            path.chmod(0o700)  # whatever the umask
        return None if _only_ours(path.stat()) else "it belongs to others, or others may write it"
    except OSError as error:
        return error.strerror or str(error)


def _candidates() -> Iterator[Path]:
    given, of_numba = os.environ.get(VARIABLE), vars(config).get("CACHE_DIR")
    if of_numba and not given:
        yield Path(of_numba).absolute() / "nablahog" / "machine-code"
    with suppress(FileNotFoundError):  # no home
        yield cache_folder() / "machine-code"
    if not given:
        yield Path(__file__).parents[1] / "__pycache__" / "machine-code"


def _only_ours(state: os.stat_result) -> bool:
    """Whether a file or folder is this user's, and nobody else may write it; not asked on Windows."""
    return not hasattr(os, "geteuid") or (state.st_uid == os.geteuid() and not state.st_mode & 0o022)
