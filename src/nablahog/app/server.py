"""The server of the page: its files, and the JSON API that they use."""

from __future__ import annotations

import asyncio
import errno
import json
import secrets
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import aclosing, asynccontextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute

from ..io.images import SAMPLE_NAMES, sample_photograph
from ..render import Camera, pose, render, sample_chairs
from ..render.camera import to_camera, to_screen
from ..requests.options import integer
from ..runtime.errors import explain
from ..viz.html import TEMPLATES
from . import see, uploads
from .about import about
from .access import AccessMiddleware, AccessRules
from .fit import Fitting, read_camera
from .invert import invert
from .messages import (
    SEE_SIZE,
    HogMessage,
    InvertMessage,
    PoseMessage,
    RequestError,
    as_answer,
    as_request_error,
    decode,
    encode_png,
)
from .socket import FitSocket
from .store import DescriptorEntry, MeshEntry, Photograph, Store, requested_descriptor
from .work_queue import CancelToken, WorkQueue

STATIC = Path(__file__).with_name("static")
SHARED = ("wipe.js", "wipe.css")  # with the pages that commands write
TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
OFFERED_CHAIRS = ("wooden-0", "windsor-0", "tubular-0", "office-0", "shell-0", "club-0")  # of the sample chairs
CHAIR_POSE = (35.0, 20.0, 3.0)  # azimuth and elevation in degrees, and distance, of the chair in a photograph
SCENE_SIZE, SCENE_FOCAL = 224, 420.0  # pixels of that photograph
MOST_QUICK, MOST_LONG = 64, 32  # computations that may wait in each queue
UPLOADS_AT_ONCE, UPLOAD_SECONDS = 4, 60.0
Answer = TypeVar("Answer")
Handler: TypeAlias = Callable[[Request], Awaitable[Response]]
StoreFile: TypeAlias = Callable[[bytes, str, Mapping[str, str], Store], dict[str, Any]]


class Server:
    """The state that the routes share: uploads, and the queues where it computes."""

    def __init__(self, photographs: Sequence[Photograph] = ()) -> None:
        self.store = Store(secrets.token_bytes(16))
        self.quick, self.long = WorkQueue("quick", MOST_QUICK), WorkQueue("long", MOST_LONG)
        self._uploads = asyncio.Semaphore(UPLOADS_AT_ONCE)
        for number, photograph in enumerate(photographs):
            self.store.pin(f"photo-{number}", photograph)

    @asynccontextmanager
    async def lifespan(self, _: Starlette) -> AsyncIterator[None]:
        """Reads the samples while the page is already there; closes the queues at the end."""
        self._about = asyncio.create_task(self.quick.run(lambda _: self._samples()))
        yield
        self._about.cancel()
        self.quick.close()
        self.long.close()

    def _samples(self) -> dict[str, Any]:
        """Puts the samples into the store; says what there is."""
        for name in SAMPLE_NAMES:
            self.store.pin(f"sample-{name}", Photograph(f"{name}.png", sample_photograph(name)))
        self.store.pin("scene-chair", _chair_scene())
        for name in OFFERED_CHAIRS:
            self.store.pin(f"chair-{name}", MeshEntry(name, sample_chairs()[name], packaged=True))
        return about(self.store)

    def routes(self) -> list[Route | WebSocketRoute]:
        paths = [*sorted(STATIC.iterdir()), *(TEMPLATES / name for name in SHARED)]
        files = {path.name: Response(path.read_bytes(), media_type=TYPES[path.suffix]) for path in paths}
        return [
            Route("/", files["index.html"], methods=["GET"]),
            *(Route(f"/static/{name}", file, methods=["GET"]) for name, file in files.items()),
            Route("/api/about", _with_json_errors(self._what_there_is)),
            Route("/api/photos", self._upload("photo", uploads.store_photograph), methods=["POST"]),
            Route("/api/photos/{id}", _with_json_errors(self._photograph)),
            Route("/api/descriptors", self._upload("descriptor", uploads.store_descriptor), methods=["POST"]),
            Route("/api/meshes", self._upload("model", uploads.store_mesh), methods=["POST"]),
            Route("/api/cameras", self._upload("camera", read_camera), methods=["POST"]),
            Route("/api/hog", _with_json_errors(self._hog), methods=["POST"]),
            Route("/api/hog/{id}/cell", _with_json_errors(self._cell)),
            Route("/api/hog/{id}/file", _with_json_errors(self._descriptor_file)),
            Route("/api/invert", _with_json_errors(self._invert), methods=["POST"]),
            Route("/api/pose", _with_json_errors(self._pose), methods=["POST"]),
            WebSocketRoute("/api/fit", self._fit),
        ]

    async def _what_there_is(self, _: Request) -> Response:
        return JSONResponse(await self.ready())

    async def ready(self) -> dict[str, Any]:
        """The answer of ``/api/about``, once the samples are read."""
        return await asyncio.shield(self._about)

    def _upload(self, default: str, store_file: StoreFile) -> Handler:
        """The handler of uploads of a kind; few are in memory at once, and slow ones are refused."""

        async def uploaded(request: Request) -> Response:
            name, query = _read_name(request, default), dict(request.query_params)
            async with self._uploads:
                try:
                    data = await asyncio.wait_for(request.body(), UPLOAD_SECONDS)
                except asyncio.TimeoutError:
                    raise RequestError(
                        408, f"the upload took more than {UPLOAD_SECONDS:g} seconds; try again"
                    ) from None
                return await self._json(request, self.quick, lambda _: store_file(data, name, query, self.store))

        return _with_json_errors(uploaded)

    async def _photograph(self, request: Request) -> Response:
        photograph, size = self.store.get(request.path_params["id"], Photograph), _read_integer(request, "size", 1024)
        picture = await self.quick.run(lambda _: encode_png(photograph.shrunk(max(8, min(size, SEE_SIZE)))))
        return Response(picture, media_type="image/png")

    async def _hog(self, request: Request) -> Response:
        message = decode(await request.body(), HogMessage)
        return await self._json(request, self.quick, lambda _: see.see(message, self.store))

    async def _cell(self, request: Request) -> Response:
        entry = self.store.get(request.path_params["id"], DescriptorEntry)
        row, col = _read_integer(request, "row"), _read_integer(request, "col")
        return await self._json(request, self.quick, lambda _: see.cell(entry, row, col))

    async def _descriptor_file(self, request: Request) -> Response:
        entry = self.store.get(request.path_params["id"], DescriptorEntry)
        data = await self.quick.run(lambda _: see.encode_descriptor(entry))
        headers = {"content-disposition": 'attachment; filename="descriptor.npz"'}
        return Response(data, media_type="application/octet-stream", headers=headers)

    async def _pose(self, request: Request) -> Response:
        message = decode(await request.body(), PoseMessage)

        def fitted(cancel: CancelToken) -> dict[str, Any]:
            fitting = Fitting.open(message, self.store)
            return fitting.figures(fitting.fit(message, None, cancel), message)

        return await self._json(request, self.long, fitted)

    async def _invert(self, request: Request) -> Response:
        message = decode(await request.body(), InvertMessage)
        # a refusal here has an HTTP status
        entry = await self.quick.run(lambda _: requested_descriptor(message, self.store))
        with as_request_error():
            message = replace(message, template=entry.template)
        return StreamingResponse(self._frames(message, entry), media_type="text/event-stream")

    async def _frames(self, message: InvertMessage, entry: DescriptorEntry) -> AsyncIterator[bytes]:
        """The events of an inversion; when the page goes, this is closed, and the search ends."""
        search = partial(invert, message, entry, self.store)
        yield _encode_event("queued", {"waiting": self.long.count})
        try:
            async with aclosing(self.long.stream(search, lambda event: event[0] == "frame")) as events:
                async for event in events:
                    yield _encode_event(*event)
        except Exception as error:
            yield _encode_event("error", as_answer(error).answer)

    async def _fit(self, socket: Any) -> None:
        await self.ready()
        await FitSocket(socket, self.store, self.quick, self.long).run()

    async def _json(
        self, request: Request, queue: WorkQueue, work: Callable[[CancelToken], dict[str, Any]]
    ) -> Response:
        """The answer of work that ends when the page does not wait for it any more."""
        return JSONResponse(await _while_connected(request, queue.run(work)))


async def _while_connected(request: Request, work: Awaitable[Answer]) -> Answer:
    """The result of ``work``, which is cancelled if the other side hangs up."""
    task = asyncio.ensure_future(work)
    gone = asyncio.ensure_future(_disconnected(request))
    try:
        await asyncio.wait((task, gone), return_when=asyncio.FIRST_COMPLETED)
        if not task.done():
            raise ClientDisconnect
        return task.result()
    finally:
        task.cancel()
        gone.cancel()
        with suppress(asyncio.CancelledError, RequestError):
            await task


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _chair_scene() -> Photograph:
    """The first of the chairs in front of a sample photograph, with its box."""
    mesh, clutter = sample_chairs()[OFFERED_CHAIRS[0]], sample_photograph("coffee")[:, :SCENE_SIZE, :SCENE_SIZE]
    camera, poses = Camera(SCENE_FOCAL, SCENE_SIZE, SCENE_SIZE), pose(*CHAIR_POSE).expand(3, 6)
    image = render(mesh, poses, camera, background=clutter[:, None])[:, 0]  # each colour is a background
    corners = to_screen(to_camera(mesh.vertices, poses[:1]), poses[:1], camera)[0, :, :2]
    box = (*corners.amin(0).tolist(), *corners.amax(0).tolist())
    return Photograph("chair.png", image, tuple(round(side, 1) for side in box))


def _with_json_errors(handler: Handler) -> Handler:
    """A handler whose errors are JSON."""

    async def answered(request: Request) -> Response:
        try:
            await request.app.state.server.ready()
            return await handler(request)
        except ClientDisconnect:
            return Response(status_code=499)  # nobody reads it
        except HTTPException:
            raise
        except Exception as error:
            refusal = as_answer(error)
            return JSONResponse(refusal.answer, refusal.status)

    return answered


async def _no_such_address(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail.lower()}, error.status_code)


def _encode_event(name: str, data: dict[str, Any]) -> bytes:
    return f"event: {name}\ndata: {json.dumps(data, allow_nan=False)}\n\n".encode()


def _read_name(request: Request, default: str) -> str:
    """The user's name of an uploaded file; it is shown, and its ending is read, nothing else."""
    name = request.query_params.get("name", default)[-120:].replace("\\", "/").rpartition("/")[2]
    return "".join(character if character.isprintable() else "�" for character in name) or default


def _read_integer(request: Request, name: str, default: int | None = None) -> int:
    with as_request_error():
        return int(integer(0).read(name, request.query_params.get(name, "" if default is None else str(default))))


def make_app(rules: AccessRules, photographs: Sequence[Photograph] = ()) -> Starlette:
    """The application, with the photographs that were given on the command line."""
    server = Server(photographs)
    app = Starlette(
        routes=server.routes(), lifespan=server.lifespan, exception_handlers={HTTPException: _no_such_address}
    )
    app.add_middleware(AccessMiddleware, rules=rules)
    app.state.server = server
    return app


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; the connections that it accepts send at once."""
    try:
        listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        reason = explain(error).partition(" (while")[0]  # Python repeats the address
        free = "; --port 0 takes a free one" if error.errno == errno.EADDRINUSE else ""
        raise ValueError(f"cannot listen at {host}, port {port}: {reason}{free}") from None
    # asyncio does so only for sockets that name their protocol: the end of an answer would wait for 40 ms
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listening
