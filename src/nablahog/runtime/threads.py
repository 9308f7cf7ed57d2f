"""Work shared out to threads, in loops that let go of Python's lock while they run."""

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

    Inside of ``work`` PyTorch takes one thread: threads of its own would wait for each other, which keeps processors
    busy that others need.
    """
    threads = torch.get_num_threads()
    if threads == 1 or count < 2:
        return [work(k) for k in range(count)]
    return list(_pool(threads).map(work, range(count)))


def share_out(work: Callable[[int, int], None], count: int) -> None:
    """``work(start, stop)`` of equal parts of ``count`` things in a row, as many as threads, one of them the caller's.

    It is for loops that call nothing of PyTorch's.
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
    torch.set_num_threads(threads)  # a part of that setting is that of all threads
    return pool


def _one_thread() -> None:
    torch.get_num_threads()  # which, the first time in a thread, sets the number to that of all threads
    torch.set_num_threads(1)


if hasattr(os, "register_at_fork"):  # a forked process has the pool, but not its threads
    os.register_at_fork(after_in_child=_pool.cache_clear)
