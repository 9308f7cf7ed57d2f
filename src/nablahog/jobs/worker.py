"""One job at a time, in a process of its own or here, and the files of the client that it reads.

This module loads nothing that takes time: a process whose parent is killed while it loads PyTorch ends at once, too.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import Protocol, TypeVar

from ..runtime.errors import explain

R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)

CGROUP = Path("/sys/fs/cgroup")
TO_STOP = 0.5  # seconds in which a worker removes the file that it was writing
DIED = "the process at work on it died, and died again when the job ran alone"
_COPIES_OF_FILES: dict[str, Path] = {}
_FOLDERS: list[Path] = []  # at most one, on a worker of a cluster


class Work(Protocol[R_co]):
    """Work that can be sent to another process; its result is not text.

    If it reads files, it has a method ``files`` that returns their paths, and opens :func:`local_path` of them.
    """

    def run(self) -> R_co:
        """Does the work; the same result every time.

        Raises:
            ValueError, OSError: why there is no result, in one sentence.
        """


def attempt(job: Work[R]) -> R | str:
    """Runs a job; returns its result, or one sentence why it failed."""
    try:
        return job.run()
    except (ValueError, OSError) as error:
        return _join_lines(error)
    except MemoryError:
        return "not enough memory"
    except Exception as error:  # a mistake in one method should not end hours of work on others
        if isinstance(error, RuntimeError) and "memory" in str(error):
            return "not enough memory"
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}: {_join_lines(error)}"


def _join_lines(error: Exception) -> str:
    return " ".join(explain(error).split())


def attempt_or_stop(job: Work[R]) -> R | str:
    """As :func:`attempt`, in a worker; a signal to stop removes the file that the job was writing, and ends it."""
    try:
        return attempt(job)
    except SystemExit:  # a pool would take it for the job's outcome
        os._exit(1)


def begin() -> None:
    """Makes this process a worker, which computes in one thread and ends with its parent, or when it is told to."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(1)  # the same sums in the same order, however many workers there are
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # from here on, a file may be half written


def _end_with_parent() -> None:
    """Ends this process when its parent ends, even if the parent is killed."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        signal.raise_signal(signal.SIGTERM)
        time.sleep(TO_STOP)
        os._exit(1)


def cores() -> int:
    """The number of cores this process may use: those that it may run on, or fewer where a container has a quota."""
    free = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return math.ceil(min(free, _quota(CGROUP)))


def _quota(cgroup: Path) -> float:
    """The cores' worth of time that Linux's control group allows, version 2 or 1; infinity for no limit."""
    with suppress(OSError, ValueError, ZeroDivisionError):
        if (cgroup / "cpu.max").exists():
            quota, period = (cgroup / "cpu.max").read_text().split()
        else:
            quota, period = ((cgroup / "cpu" / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
        cores = float(quota) / float(period)  # ValueError: "max", no limit; below 0: none in version 1
        return cores if cores > 0 else math.inf
    return math.inf


@contextmanager
def one_thread() -> Iterator[None]:
    """Child processes started in the block compute in one thread each: the libraries under PyTorch read this first."""
    before = os.environ.get("OMP_NUM_THREADS")
    os.environ["OMP_NUM_THREADS"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["OMP_NUM_THREADS"]
        else:
            os.environ["OMP_NUM_THREADS"] = before


def store_files(files: dict[str, bytes], folder: Path) -> None:
    """Writes contents, by their paths on the client, into a folder of this worker, for :func:`local_path`."""
    folder.mkdir(parents=True, exist_ok=True)
    _FOLDERS[:] = [folder]
    for number, (path, data) in enumerate(files.items()):
        copy = folder / f"{number}{Path(path).suffix}"
        copy.write_bytes(data)
        _COPIES_OF_FILES[path] = copy


def local_path(path: Path) -> Path:
    """The copy on this machine of a file of the client; the path itself where there is none."""
    return _COPIES_OF_FILES.get(str(path), path)


def local_folder(path: Path) -> Path:
    """A folder where jobs keep what others need, too: the client's, where this machine has it, or one of the worker."""
    return path if path.is_dir() or not _FOLDERS else _FOLDERS[0] / path.name
