"""How fast does the page of `nablahog app` answer in a real browser, and what does its server keep after load?

    python benchmarks/app.py page [--repeats 15]
    python benchmarks/app.py load [--pages 20] [--uploads 200]

Page: times are taken in Chromium, from the event to the frame that shows its result; median and range, warm.

Load: pages at once, aborted uploads, and pages that are closed in the middle of long work.  After each, the server's
processor time and memory are read: an idle server takes no processor time, and keeps no more than its store may hold.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import websockets

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.app.browser import Page, browsing, serving

STATIC = Path(__file__).parent.parent / "src" / "nablahog" / "app" / "static"
# calls `done` with the milliseconds from `trigger` to the frame in which an attribute of an element has changed
TIMED = """
const done = arguments[arguments.length - 1], [selector, attribute, trigger, value] = arguments;
const element = document.querySelector(selector), before = element.getAttribute(attribute);
const run = new Function("value", trigger);
(value === "photograph" ? photograph() : Promise.resolve(value)).then((prepared) => {
  const began = performance.now();
  new MutationObserver((_, observer) => {
    if (element.getAttribute(attribute) === before) return;
    observer.disconnect();
    requestAnimationFrame(() => done(performance.now() - began));
  }).observe(element, {attributes: true});
  run(prepared);
});
async function photograph() {
  const side = 512, canvas = new OffscreenCanvas(side, side), context = canvas.getContext("2d");
  for (let k = 0; k < 400; k++) {
    context.fillStyle = `hsl(${Math.random() * 360} 60% ${Math.random() * 100}%)`;
    context.fillRect(Math.random() * side, Math.random() * side, Math.random() * 90, Math.random() * 90);
  }
  return new File([await canvas.convertToBlob({type: "image/png"})], "drawn.png", {type: "image/png"});
}
"""
DROP = """
const data = new DataTransfer();
data.items.add(value);
document.body.dispatchEvent(new DragEvent("drop", {bubbles: true, cancelable: true, dataTransfer: data}));
"""
ENTER = """
const control = document.querySelector("#controls [name=cell_size]");
control.value = value;
for (const kind of ["input", "change"]) control.dispatchEvent(new Event(kind, {bubbles: true}));
"""
DRAG = """
const scene = document.querySelector("#scene"), box = scene.getBoundingClientRect();
const pointer = {bubbles: true, pointerId: 1, isPrimary: true, button: 0, buttons: 1, clientY: box.y + 90};
const at = (x) => ({...pointer, clientX: box.x + x});
scene.dispatchEvent(new PointerEvent("pointerdown", at(100)));
scene.dispatchEvent(new PointerEvent("pointermove", at(100 + value)));
scene.dispatchEvent(new PointerEvent("pointerup", at(100 + value)));
"""
# calls `done` with the milliseconds from a click on Start to each frame, and to the end
FRAMES = """
const done = arguments[arguments.length - 1], canvas = document.querySelector("#preimage"), times = [];
const began = performance.now();
new MutationObserver((_, observer) => {
  if (canvas.dataset.frames !== "0") times.push(performance.now() - began);
  if (canvas.dataset.state !== "running") { observer.disconnect(); done(times); }
}).observe(canvas, {attributes: true, attributeFilter: ["data-frames", "data-state"]});
document.querySelector("#invert-start").click();
"""
PHOTO = b"\x89PNG\r\n\x1a\n" + bytes(400_000)
SCENE = {"photo": "scene-chair", "mesh": "chair-wooden-0"}
LONG: dict[str, dict[str, Any]] = {
    "/api/invert": {"photo": "sample-astronaut", "size": 512, "prior": "none"},
    "/api/pose": {**SCENE, "method": "paper"},
    "/api/hog": {"photo": "sample-astronaut", "size": 1024},
}
TURN = {"type": "pose", "pose": [10, 20, 3, 0, 0, 0]}


def timed(page: Page, selector: str, attribute: str, trigger: str, values: list[Any]) -> list[float]:
    """Milliseconds of each value, but the first, which warms up."""
    taken = []
    for value in values:
        page.driver.set_script_timeout(60)
        taken.append(page.driver.execute_async_script(TIMED, selector, attribute, trigger, value))
        page.idle()
    return taken[1:]


def said(name: str, values: list[float], unit: str, goal: str) -> None:
    low, middle, high = min(values), statistics.median(values), max(values)
    print(f"| {name} | {middle:.0f} ({low:.0f}–{high:.0f}) {unit} | {goal} |", flush=True)


def measure(page: Page, repeats: int) -> None:
    print("| | median (range) | goal |\n|---|---:|---:|")
    page.open("#/see?photo=sample-astronaut&preset=uoctti&size=512")
    page.idle()
    drops = timed(page, "#glyphs", "data-key", DROP, ["photograph"] * repeats)
    said("drop of a 512² photograph to glyphs", drops, "ms", "100")
    sizes = timed(page, "#glyphs", "data-key", ENTER, [6 + k % 9 for k in range(repeats)])
    said("slider to new glyphs", sizes, "ms", "50")
    page.open("#/invert?photo=sample-astronaut&preset=uoctti&size=256")
    page.idle()
    first, rates = [], []
    for _ in range(min(repeats, 5)):
        times = page.driver.execute_async_script(FRAMES)
        page.idle()
        first.append(times[0])
        rates.append((len(times) - 2) / (times[-2] - times[0]) * 1000)
    said("first frame of a pre-image, 256²", first[1:], "ms", "300")
    said("frames a second", rates[1:], "", "≥ 10")
    page.open("#/fit?photo=scene-chair&mesh=chair-wooden-0")
    page.click("#fit-open")
    page.until("document.querySelector('#scene').dataset.n > 0")
    page.idle()
    drags = timed(page, "#scene", "data-n", DRAG, [(-1) ** k * (10 + k) for k in range(repeats)])
    said("drag to rendering and similarity", drags, "ms", "40")


def of_page(options: argparse.Namespace) -> None:
    with serving() as address, tempfile.TemporaryDirectory() as profile, browsing(Path(profile)) as driver:
        measure(Page(driver, address), options.repeats)
    seconds = []
    for _ in range(4):
        began = time.monotonic()
        server = Server()
        urllib.request.urlopen(f"http://127.0.0.1:{server.port}/").read()
        seconds.append(time.monotonic() - began)
        server.end()
    said("start to first page", seconds[1:], "s", "3")
    print(f"| bytes of the page | {sum(file.stat().st_size for file in STATIC.iterdir()):,} | 250,000 |")


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

    def end(self) -> str:
        """What it has written to stderr."""
        self.process.terminate()
        return self.process.communicate(timeout=20)[1].strip()

    def processor_seconds(self) -> float:
        """Processor seconds spent so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def megabytes(self) -> float:
        """Megabytes of memory in use."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    async def post(self, path: str, asked: dict[str, Any], *, leave_after: int | None = None) -> bytes:
        """The answer; with ``leave_after``, the connection is closed after so many bytes of it."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        body = json.dumps(asked).encode()
        headers = f"host: 127.0.0.1:{self.port}", f"content-length: {len(body)}", "connection: close"
        writer.write("\r\n".join([f"POST {path} HTTP/1.1", *headers, "", ""]).encode() + body)
        try:
            return await (reader.read() if leave_after is None else reader.read(leave_after))
        finally:
            writer.close()

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


async def visit(server: Server, number: int) -> str:
    """What somebody does: looks, inverts, turns a chair."""
    await server.post("/api/hog", {"photo": "sample-camera", "size": 256})
    asked = {"photo": "sample-camera", "size": 64, "quality": "fast", "seed": number, "prior": "none"}
    answer = await server.post("/api/invert", asked)
    async with websockets.connect(f"ws://127.0.0.1:{server.port}/api/fit", max_size=2**24) as connection:
        await connection.send(json.dumps({"type": "open", **SCENE}))
        if json.loads(await connection.recv())["type"] != "ready":
            return "busy"
        for n in range(30):
            await connection.send(json.dumps({**TURN, "n": n}))
            await connection.recv()
    return "done" if b"event: done" in answer else "busy"


async def load(options: argparse.Namespace) -> None:
    server = Server()
    print("| trial | seconds | idle after, s | memory, MB |\n|---|---:|---:|---:|")

    async def trial(name: str, work: Callable[[], Awaitable[Any]]) -> None:
        began = time.monotonic()
        ends = await work()
        told = f": {ends.count('done')} done" if ends else ""
        seconds, rest = time.monotonic() - began, await idle(server)
        print(f"| {name}{told} | {seconds:.1f} | {rest:.1f} | {server.megabytes():.0f} |", flush=True)

    async def pages(count: int) -> list[str]:
        return await asyncio.gather(*(visit(server, number) for number in range(count)))

    async def uploads() -> None:
        for number in range(options.uploads):
            await asyncio.to_thread(server.upload_and_leave, number / options.uploads)

    async def left(path: str, asked: dict[str, Any]) -> None:
        for _ in range(3):
            task = asyncio.create_task(server.post(path, asked, leave_after=500))
            await asyncio.sleep(0.3)
            task.cancel()

    try:
        await trial("first page", partial(pages, 1))
        await trial(f"{options.pages} pages at once", partial(pages, options.pages))
        await trial(f"{options.uploads} aborted uploads", uploads)
        for path, asked in LONG.items():
            await trial(f"closed in the middle: {path}", partial(left, path, asked))
        await trial(f"{options.pages} pages at once, again", partial(pages, options.pages))
    finally:
        print(f"\nstderr: {server.end() or 'nothing'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    page = commands.add_parser("page")
    page.add_argument("--repeats", type=int, default=15)
    page.set_defaults(run=of_page)
    of_load = commands.add_parser("load")
    of_load.add_argument("--pages", type=int, default=20)
    of_load.add_argument("--uploads", type=int, default=200)
    of_load.set_defaults(run=lambda options: asyncio.run(load(options)))
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
