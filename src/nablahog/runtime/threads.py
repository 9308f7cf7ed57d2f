"""Work shared out to threads, for loops that release Python's lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

import torch

Result = TypeVar("Result")


def in_threads(work: Callable[[int], Result], count: int) -> list[Result]:
    """``work(0)`` … ``work(count - 1)``, in as many threads as PyTorch takes.

    Inside ``work`` PyTorch takes one thread: several pools would wait for each other with busy processors.
    """
    threads = torch.get_num_threads()
    if threads == 1 or count < 2:
        return [work(k) for k in range(count)]
    return list(_pool(threads).map(work, range(count)))


def share_out(work: Callable[[int, int], None], count: int) -> None:
    """Calls ``work(start, stop)`` for equal parts of ``range(count)``, one a thread; the caller's thread takes one.

    For loops that call nothing of PyTorch.
    """
    threads = torch.get_num_threads()
    parts = min(threads, count)
    if parts < 2:
        if count:
            work(0, count)
        return
    ends = [count * k // parts for k in range(1, parts + 1)]
    others = [_pool(threads).submit(work, *each) for each in pairwise(ends)]
    try:
        work(0, ends[0])
    finally:
        wait(others)
    for other in others:
        other.result()


@lru_cache
def _pool(threads: int) -> ThreadPoolExecutor:
    pool = ThreadPoolExecutor(threads, "nablahog", initializer=_one_thread)
    started = threading.Barrier(threads)
    list(pool.map(lambda _: started.wait(), range(threads)))
    torch.set_num_threads(threads)  # the pool's threads have changed the part of the setting that is global
    return pool


def _one_thread() -> None:
    torch.get_num_threads()  # its first call in a thread sets the number to the global one
    torch.set_num_threads(1)


def _after_fork() -> None:
    """A forked process has the pools of its parent, OpenMP's too, without their threads, and would wait for these."""
    _pool.cache_clear()
    torch.set_num_threads(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
