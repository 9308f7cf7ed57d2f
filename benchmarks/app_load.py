"""The server of `nablahog app` under load and faults: what is left running, and how much memory stays.

    python benchmarks/app_load.py [--pages 20] [--uploads 200] [--requests 1000]

Starts a server of its own.  After each trial its processor time and its memory are read: an idle server takes no
processor time, and keeps no more than what its store may hold.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import re
import socket
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import websockets

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.app.test_garbage import FIT, GETS, JSON, UPLOADS, mutated, noise

PHOTO = b"\x89PNG\r\n\x1a\n" + bytes(400_000)
LONG: dict[str, tuple[str, dict[str, Any]]] = {
    "invert": ("/api/invert", {"photo": "sample-astronaut", "size": 512, "method": "no-prior"}),
    "invert as the paper": ("/api/invert", {"photo": "sample-astronaut", "size": 256, "method": "paper"}),
    "compare": (
        "/api/compare",
        {"photo": "sample-astronaut", "a": {"preset": "opencv"}, "b": {"preset": "paper"}, "size": 1024},
    ),
    "pose": ("/api/pose", {"photo": "scene-chair", "mesh": "chair-3", "method": "paper"}),
    "hog": ("/api/hog", {"photo": "sample-astronaut", "size": 1024}),
}


class Server:
    """A server in a process of its own."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "nablahog", "app", "--port", "0"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        match = re.search(r":(\d+)/", line)
        assert match is not None, line
        self.port = int(match[1])

    def processor_seconds(self) -> float:
        """Spent so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def megabytes(self) -> float:
        """Of memory."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    async def request(
        self, method: str, path: str, body: bytes, *, leave_after: int | None = None
    ) -> tuple[int, bytes]:
        """The answer to a request; with ``leave_after``, the connection is closed after so many bytes of an answer."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        headers = f"host: 127.0.0.1:{self.port}", f"content-length: {len(body)}", "connection: close"
        writer.write("\r\n".join([f"{method} {path} HTTP/1.1", *headers, "", ""]).encode() + body)
        try:
            answer = await (reader.read() if leave_after is None else reader.read(leave_after))
        finally:
            writer.close()
        status = answer.split(b" ", 2)[1:2]
        return (int(status[0]) if status else 0), answer

    def upload_and_leave(self, share: float) -> None:
        """Sends a part of a photograph, and closes."""
        with socket.create_connection(("127.0.0.1", self.port)) as connection:
            head = f"POST /api/photos HTTP/1.1\r\nhost: 127.0.0.1:{self.port}\r\ncontent-length: {len(PHOTO)}\r\n\r\n"
            connection.sendall(head.encode() + PHOTO[: int(share * len(PHOTO))])


async def idle(server: Server) -> float:
    """Seconds until the server takes no processor time."""
    began = time.monotonic()
    while time.monotonic() - began < 120:
        before = server.processor_seconds()
        await asyncio.sleep(0.5)
        if server.processor_seconds() - before < 0.03:
            return time.monotonic() - began - 0.5
    raise SystemExit("the server goes on computing")


async def a_page(server: Server, number: int) -> str:
    """What somebody does: looks, inverts, turns a chair."""
    asked = {"photo": "sample-camera", "size": 256}
    await server.request("POST", "/api/hog", json.dumps(asked).encode())
    inverted = {"photo": "sample-camera", "size": 64, "quality": "fast", "seed": number, "method": "no-prior"}
    status, answer = await server.request("POST", "/api/invert", json.dumps(inverted).encode())
    async with websockets.connect(f"ws://127.0.0.1:{server.port}/api/fit", max_size=2**24) as connection:
        await connection.send(json.dumps({"type": "open", "photo": "scene-chair", "mesh": "chair-3"}))
        if json.loads(await connection.recv())["type"] != "ready":
            return "busy"
        for n in range(30):
            await connection.send(json.dumps({**FIT, "n": n, "pose": [n, 20, 3, 0, 0, 0]}))
            await connection.recv()
    return "busy" if status == 503 else "done" if b"event: done" in answer else f"status {status}"


async def leave_fit(server: Server, message: dict[str, Any]) -> str:
    async with websockets.connect(f"ws://127.0.0.1:{server.port}/api/fit", max_size=2**24) as connection:
        await connection.send(json.dumps({"type": "open", "photo": "scene-chair", "mesh": "chair-3"}))
        await connection.recv()
        await connection.send(json.dumps(message))
        await asyncio.sleep(0.05)
    return ""


async def run(options: argparse.Namespace) -> None:
    server = Server()
    print("| trial | seconds | idle after, s | memory, MB |\n|---|---:|---:|---:|")
    print(f"| start | – | – | {server.megabytes():.0f} |")

    async def trial(name: str, work: Callable[[], Awaitable[str]]) -> None:
        began = time.monotonic()
        remark = await work()
        seconds, rest = time.monotonic() - began, await idle(server)
        what = f"{name}: {remark}" if remark else name
        print(f"| {what} | {seconds:.1f} | {rest:.1f} | {server.megabytes():.0f} |", flush=True)

    async def pages() -> str:
        ends = await asyncio.gather(*(a_page(server, number) for number in range(options.pages)))
        return ", ".join(f"{ends.count(end)} {end}" for end in sorted({*ends}))

    async def uploads() -> str:
        for number in range(options.uploads):
            await asyncio.to_thread(server.upload_and_leave, number / options.uploads)
        return ""

    async def left(path: str, asked: dict[str, Any]) -> str:
        for _ in range(3):
            task = asyncio.create_task(server.request("POST", path, json.dumps(asked).encode(), leave_after=500))
            await asyncio.sleep(0.3)
            task.cancel()
        return ""

    async def garbage() -> str:
        rng, statuses = random.Random(0), []
        for _ in range(options.requests):
            if rng.random() < 0.5:
                path, asked = rng.choice([*JSON.items()])
                body = json.dumps(mutated(asked, rng)).encode()
            else:
                path, body = rng.choice([*UPLOADS, *GETS]), noise(PHOTO[:2000], rng)
            statuses.append((await server.request("POST", path, body))[0] // 100)
        assert 5 not in statuses, "an error of the server's own"
        return ", ".join(f"{statuses.count(each)} of {each}xx" for each in sorted({*statuses}))

    try:
        await trial("first page", lambda: a_page(server, 0))
        await trial(f"{options.pages} pages at once", pages)
        await trial(f"{options.uploads} aborted uploads", uploads)
        for name, (path, asked) in LONG.items():
            await trial(f"closed in the middle: {name}", partial(left, path, asked))
        messages: list[dict[str, Any]] = [{"type": "fit", "method": "paper"}, {"type": "curve", "pose": FIT["pose"]}]
        for message in messages:
            await trial(f"closed in the middle: {message['type']} of a socket", partial(leave_fit, server, message))
        await trial(f"{options.requests} mutated requests", garbage)
        await trial(f"{options.pages} pages at once, again", pages)
    finally:
        server.process.terminate()
        _, errors = server.process.communicate(timeout=20)
    print(f"\nstderr: {errors.strip() or 'nothing'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("--pages", 20), ("--uploads", 200), ("--requests", 1000)):
        parser.add_argument(name, type=int, default=default)
    asyncio.run(run(parser.parse_args()))


if __name__ == "__main__":
    main()
