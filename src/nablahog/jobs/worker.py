"""One job at a time, in a process of its own or here.

This module loads nothing that takes time: a process whose parent is killed while it loads PyTorch ends at once, too.
"""

from __future__ import annotations

import os
import threading
import traceback
from multiprocessing import parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from .store import Work

R = TypeVar("R")


def begin() -> None:
    """Makes this process a worker, which computes in one thread and ends with its parent."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(1)  # the same sums in the same order, however many workers there are


def _end_with_parent() -> None:
    """Ends this process when its parent ends, even if the parent is killed."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def attempt(job: Work[R]) -> R | str:
    """Runs a job; returns its result, or one sentence why it failed."""
    try:
        return job.run()
    except (ValueError, OSError) as error:
        return _sentence(error)
    except MemoryError:
        return "not enough memory"
    except Exception as error:  # a mistake in one method should not end hours of work on others
        if isinstance(error, RuntimeError) and "memory" in str(error):
            return "not enough memory"
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}: {_sentence(error)}"


def _sentence(error: Exception) -> str:
    return " ".join(str(error).split())
