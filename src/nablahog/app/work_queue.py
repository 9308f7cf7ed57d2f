"""Bounded queues of computations, each with a thread, and their cancellation."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TypeVar

from .messages import RequestError

T = TypeVar("T")
MOST_WAITING = 3  # frames of a search that wait for a slow page; more are dropped


class Cancelled(Exception):
    """Raised inside work whose page does not wait for it any more."""


class CancelToken:
    """Tells running work that nobody waits for its result."""

    def __init__(self) -> None:
        self._cancelled = Event()

    def cancel(self) -> None:
        """Ends the work at its next :meth:`check`."""
        self._cancelled.set()

    def check(self) -> None:
        """Raises Cancelled if nobody waits."""
        if self._cancelled.is_set():
            raise Cancelled


class WorkQueue:
    """A thread that runs one computation after the other; at most ``most`` wait or run, ``count`` do now."""

    def __init__(self, name: str, most: int) -> None:
        self.most, self.count = most, 0
        self._executor = ThreadPoolExecutor(1, thread_name_prefix=name)

    async def run(self, work: Callable[[CancelToken], T]) -> T:
        """The result of ``work``; if this coroutine is cancelled, the work ends at its next check."""
        if self.count >= self.most:
            raise RequestError(503, f"the server is busy: {self.count} computations wait already; try again")
        cancel = CancelToken()

        def checked() -> T:
            cancel.check()
            return work(cancel)

        loop = asyncio.get_running_loop()
        future = self._executor.submit(checked)
        self.count += 1
        future.add_done_callback(lambda _: loop.call_soon_threadsafe(self._left))  # perhaps at once
        try:
            return await asyncio.wrap_future(future)
        finally:
            cancel.cancel()

    async def stream(
        self, work: Callable[[Callable[[T], None], CancelToken], None], droppable: Callable[[T], bool] = lambda _: False
    ) -> AsyncGenerator[T, None]:
        """What ``work`` sends, as it comes; when this is closed, the work ends.

        Of droppable items, at most :data:`MOST_WAITING` wait for a slow reader.
        """
        loop, sent = asyncio.get_running_loop(), asyncio.Queue[T | None]()

        def put(item: T) -> None:
            if not droppable(item) or sent.qsize() < MOST_WAITING:
                sent.put_nowait(item)

        def send(item: T) -> None:
            loop.call_soon_threadsafe(put, item)

        task = asyncio.create_task(self.run(lambda cancel: work(send, cancel)))
        task.add_done_callback(lambda _: sent.put_nowait(None))
        try:
            while (item := await sent.get()) is not None:
                yield item
            await task
        finally:
            task.cancel()

    def _left(self) -> None:
        self.count -= 1

    def close(self) -> None:
        """Begins nothing new; what runs is to be cancelled by those who asked for it."""
        self._executor.shutdown(wait=False, cancel_futures=True)
