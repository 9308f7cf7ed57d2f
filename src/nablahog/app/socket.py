"""The WebSocket of a model that is dragged: of the poses that wait, only the newest is answered."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Coroutine
from contextlib import aclosing
from functools import partial
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from .fit import Fitting
from .messages import Curve, Fit, Open, RequestError, Stop, Turn, as_answer, decode_fit_message
from .store import Store
from .work_queue import CancelToken, WorkQueue

MOST_MESSAGE_CHARACTERS = 2**14  # of a message


class FitSocket:
    """One page's scene; the socket is not yet accepted."""

    def __init__(self, socket: WebSocket, store: Store, quick: WorkQueue, long: WorkQueue) -> None:
        self.socket, self.store, self.quick, self.long = socket, store, quick, long
        self.scene: Fitting | None = None
        self._turn: Turn | None = None
        self._turning: asyncio.Task[None] | None = None
        self._work: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Answers until the page goes."""
        await self.socket.accept()
        try:
            while True:
                await self._with_errors(self._do(await self.socket.receive_text()))
        except (WebSocketDisconnect, KeyError):  # the latter: a message of bytes
            pass
        finally:
            for task in (self._turning, self._work):
                if task is not None:
                    task.cancel()

    async def _do(self, text: str) -> None:
        if len(text) > MOST_MESSAGE_CHARACTERS:
            raise RequestError(413, f"expected a message of at most {MOST_MESSAGE_CHARACTERS:,} characters")
        message = decode_fit_message(text)
        if isinstance(message, Open):
            await self._stop()
            self.scene = await self.quick.run(lambda _: Fitting.open(message, self.store))
            await self._answer(self.long, self._opened().ready)
        elif isinstance(message, Turn):
            self._opened()
            self._turn = message
            if self._turning is None or self._turning.done():
                self._turning = asyncio.create_task(self._turned())
        elif isinstance(message, Stop):
            await self._stop()
            await self._send({"type": "stopped"})
        else:
            self._opened()
            await self._stop()
            work = self._curve(message) if isinstance(message, Curve) else self._fit(message)
            self._work = asyncio.create_task(self._with_errors(work))

    def _opened(self) -> Fitting:
        if self.scene is None:
            raise RequestError(422, "expected a photograph and a model first")
        return self.scene

    async def _stop(self) -> None:
        if self._work is not None and not self._work.done():
            self._work.cancel()
            await asyncio.wait([self._work])

    async def _turned(self) -> None:
        """Answers the newest pose until there is none."""
        while self._turn is not None:
            turn, self._turn = self._turn, None
            await self._with_errors(self._answer(self.quick, partial(self._opened().view, turn)))

    async def _curve(self, message: Curve) -> None:
        """The curve, part by part, so that poses that are dragged meanwhile need not wait for all of it."""
        for part in self._opened().curve(message.pose):
            await self._answer(self.quick, part)

    async def _fit(self, message: Fit) -> None:
        """The poses that a search comes to, and its result."""
        scene = self._opened()

        def work(send: Callable[[dict[str, Any]], None], cancel: CancelToken) -> None:
            send(scene.fitted(scene.fit(message, send, cancel), message))

        async with aclosing(self.long.stream(work)) as answers:
            async for answer in answers:
                await self._send(answer)

    async def _with_errors(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except WebSocketDisconnect:
            raise
        except Exception as error:
            await self._send({"type": "error", **as_answer(error).answer})

    async def _answer(self, queue: WorkQueue, work: Callable[[], dict[str, Any]]) -> None:
        await self._send(await queue.run(lambda _: work()))

    async def _send(self, message: dict[str, Any]) -> None:
        await self.socket.send_text(json.dumps(message, allow_nan=False))
