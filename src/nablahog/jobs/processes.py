"""Processes of this machine that do jobs."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, resource_tracker
from typing import Any

from .worker import DIED, TO_STOP, Work, attempt_or_stop, begin, one_thread


class Processes:
    """An :class:`.runner.Executor`.  Processes hold nothing that must be saved: all are replaced when one dies."""

    def __init__(self, workers: int) -> None:
        self.most: float = workers
        self.at_work: dict[Future[Any], int] = {}
        self._pool: ProcessPoolExecutor | None = None
        self._size = 0

    def has_room(self) -> bool:
        return len(self.at_work) < self.most

    def submit(self, index: int, job: Work[Any], left: int) -> None:
        while True:
            pool = self._started_pool(left)
            try:
                self.at_work[pool.submit(attempt_or_stop, job)] = index
            except BrokenProcessPool:
                self.close()
            else:
                return

    def next_outcome(self) -> tuple[int, Any]:
        future = next(iter(wait(self.at_work, return_when=FIRST_COMPLETED).done))
        died = isinstance(future.exception(), BrokenProcessPool)
        return self.at_work.pop(future), DIED if died else future.result()

    def _started_pool(self, left: int) -> ProcessPoolExecutor:
        """The processes, at least one of which has started: new ones if there are none, or too many."""
        if self._pool is not None and self._size <= self.most:
            return self._pool
        self.close()
        self._size = int(min(self.most, left))
        pool = self._pool = ProcessPoolExecutor(self._size, get_context("spawn"), begin)  # a forked PyTorch may hang
        with one_thread(), _no_interrupts():
            ready = [pool.submit(abs, 0) for _ in range(self._size)]
        wait(ready, return_when=FIRST_COMPLETED)
        if any(future.done() and future.exception() for future in ready):
            raise ChildProcessError("worker processes end before they have started")
        return pool

    def close(self) -> None:
        """Stops the processes, and kills those that do not stop soon."""
        if self._pool is not None:
            processes = list((self._pool._processes or {}).values())
            for process in processes:
                process.terminate()
            latest = time.monotonic() + TO_STOP
            for process in processes:
                process.join(max(0.0, latest - time.monotonic()))
                process.kill()
            self._pool.shutdown()
            self._pool = None


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Child processes started in the block ignore Ctrl-C; the parent handles it, after the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # starting it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
