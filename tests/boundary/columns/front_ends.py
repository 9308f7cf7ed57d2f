"""The command and the page, which take files and texts."""

from __future__ import annotations

import base64
import io
import json
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from starlette.testclient import TestClient

from nablahog import Camera
from nablahog.app.access import AccessRules
from nablahog.app.server import make_app
from nablahog.cli.main import main
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import read_image
from nablahog.io.input_file import InputFile

from ..table import NotApplicable, Told, Use, column
from .files import file_of, mesh_file, stored
from .plain import BOX, CAMERA, DESCRIPTOR, IMAGE, MASK, MESH, SIZE, angle, image, name, number, size

HOST = "127.0.0.1:8765"
VIEW, FOUND = (30, 20), ("azimuth", "elevation", "distance", "theta", "x", "y")
QUICK, STORED = {"quality": "fast", "prior": "none"}, DESCRIPTOR[0].numpy()
EIGHT_BITS = 0.01  # of pictures in files


@contextmanager
def captured() -> Iterator[io.StringIO]:
    """What is written to standard error; other threads write to it as they please."""
    errors = io.StringIO()
    if threading.current_thread() is not threading.main_thread():
        yield errors
        return
    with redirect_stderr(errors), redirect_stdout(io.StringIO() if sys.stdout else None):
        yield errors


def command(*words: str) -> None:
    with captured() as errors:
        status = main(list(words))
    if status:
        raise Told(errors.getvalue().strip() or f"status {status} without a word; must not be")


def described(value: Any, *options: str) -> Any:
    ending, data = file_of(value)
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder, f"a{ending}"), Path(folder, "d.npz")
        source.write_bytes(data)
        command("hog", str(source), "-o", str(out), *options)
        return load_descriptor(out).descriptor


def pictured(value: Any, *options: str) -> Any:
    ending, data = stored(value)
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder, f"d{ending}"), Path(folder, "g.png")
        source.write_bytes(data)
        command("glyph", str(source), "-o", str(out), "--preset", "uoctti", *options)
        return read_image(out)


def as_words(value: Any, between: str = ",") -> str:
    """A value as it is written at the shell; the shell has no objects of Python."""
    value = value.tolist() if isinstance(value, np.ndarray | np.generic | torch.Tensor) else value
    if isinstance(value, list | tuple) and len(value) != 1:
        return between.join(as_words(item) for item in value)
    if isinstance(value, Enum) or not isinstance(value, str | int | float):
        raise NotApplicable
    return str(value)


def as_json(**asked: Any) -> str:
    try:
        return json.dumps(asked)
    except TypeError:
        raise NotApplicable from None


@lru_cache
def client() -> TestClient:
    """A page that lives as long as the process."""
    made = TestClient(make_app(AccessRules(frozenset({HOST}), None)), base_url=f"http://{HOST}")
    return made.__enter__()


def answer(path: str, **more: Any) -> Any:
    said = client().post(path, **more)
    if said.status_code != 200:
        raise Told(said.json()["error"])
    return said.json()


def on_page(value: Any, **asked: Any) -> Any:
    return requested(photo=photo_id(value), **asked)


def photo_id(value: Any) -> str:
    ending, data = file_of(value)
    return str(answer(f"/api/photos?name=a{ending}", content=data)["id"])


def requested(**asked: Any) -> Any:
    key = answer("/api/hog", content=as_json(**{"preset": "uoctti", **asked}))["key"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "d.npz")
        path.write_bytes(client().get(f"/api/hog/{key}/file").content)
        return load_descriptor(path).descriptor


def uploaded(value: Any) -> Any:
    return requested(descriptor=descriptor_id(value))


def descriptor_id(value: Any, **more: str) -> str:
    ending, data = stored(value)
    asked = {"name": f"d{ending}", "preset": "uoctti", **more}
    return str(answer("/api/descriptors", params=asked, content=data)["id"])


def focal(camera: Any) -> Any:
    """What a front end is told about a camera, whose sides are those of the photograph."""
    if isinstance(camera, Camera) and (camera.height, camera.width) != (CAMERA.height, CAMERA.width):
        raise NotApplicable
    return getattr(camera, "focal", camera)


def posed(mask: Any = None, mesh: Any = MESH, **more: Any) -> Any:
    options = {"box": BOX, "init": VIEW, "method": "exhaustive", **more}
    with tempfile.TemporaryDirectory() as folder:
        photo, model, out = Path(folder, f"a{file_of(IMAGE)[0]}"), Path(folder, "m.ply"), Path(folder, "out")
        photo.write_bytes(file_of(IMAGE)[1])
        model.write_bytes(mesh_file(mesh))
        if mask is not None:
            ending, data = file_of(mask)
            options["mask"] = str(Path(folder, f"mask{ending}"))
            Path(options["mask"]).write_bytes(data)
        flags = [f"--{name}={as_words(value)}" for name, value in options.items()]
        command("pose", str(photo), "-o", str(out), "--mesh", str(model), "--least-confidence=0", *flags)
        (found,) = json.loads((out / "poses.json").read_text())["annotations"]
    return [found[name] for name in FOUND]


def posed_on_page(mesh: Any = MESH, **more: Any) -> Any:
    model = answer("/api/meshes?name=m.ply", content=mesh_file(mesh))["id"]
    asked = {"photo": photo_id(IMAGE), "mesh": model, "box": BOX, "initial": VIEW, "method": "exhaustive", **more}
    found = answer("/api/pose", content=as_json(**asked))
    return [found[name] for name in FOUND]


def inverted(*options: str, preset: Any = "uoctti", **more: Any) -> Any:
    """The pre-image of a descriptor in a file; in one row, other sizes would be tried, too, which takes longer."""
    flags = [f"--{name.replace('_', '-')}={as_words(value, 'x')}" for name, value in (QUICK | more).items()]
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder, "d.npy"), Path(folder, "out")
        source.write_bytes(stored(STORED)[1])
        command("invert", str(source), "-o", str(out), f"--preset={as_words(preset)}", *flags)
        return read_image(out / "d_preimage.png")


def inverted_on_page(image_size: Any = SIZE, **more: Any) -> Any:
    row = STORED.reshape(-1)  # an empty size is none, which only a row needs
    descriptor = descriptor_id(row, image_size=as_words(image_size, "x"))
    events = answer_events("/api/invert", content=as_json(descriptor=descriptor, **QUICK, **more))
    return read_image(InputFile("a.png", base64.b64decode(events["done"]["image"])))


def answer_events(path: str, **more: Any) -> dict[str, Any]:
    """The last event of each name."""
    said = client().post(path, **more)
    if said.status_code != 200:
        raise Told(said.json()["error"])
    lines = [block.split("\n") for block in said.text.strip().split("\n\n")]
    events = {name.removeprefix("event: "): json.loads(data.removeprefix("data: ")) for name, data in lines}
    if "error" in events:
        raise Told(events["error"]["error"])
    return events


COLUMNS = [
    column(
        "command",
        image=image(described),
        descriptor=Use(pictured, DESCRIPTOR[0], lambda d: d.numpy()),
        name=name(lambda n: described(IMAGE, "--preset", as_words(n))),
        number=number(lambda n: described(IMAGE, f"--size={as_words(n)}"), 32),
        tolerance=1e-3,
        types=(np.ndarray, Image.Image),
    ),
    column(
        "page",
        image=image(on_page),
        descriptor=Use(uploaded, DESCRIPTOR[0], lambda d: d.numpy()),
        name=name(lambda n: on_page(IMAGE, preset=n)),
        number=number(lambda n: on_page(IMAGE, size=n), 32),
        tolerance=1e-3,
        types=(np.ndarray, Image.Image),
    ),
    column(
        "nablahog pose",
        box=Use(lambda b: posed(box=b), BOX),
        angle=angle(lambda a: posed(init=(30, a)), 20.0),
        number=number(lambda n: posed(seed=n), 3),
        camera=Use(lambda c: posed(focal=focal(c)), CAMERA),
        mask=Use(lambda m: posed(mask=m), MASK),
        mesh=Use(lambda m: posed(mesh=m), MESH),
        tolerance=0.05,
    ),
    column(
        "page /api/pose",
        box=Use(lambda b: posed_on_page(box=b), BOX),
        angle=angle(lambda a: posed_on_page(initial=(30, a)), 20.0),
        number=number(lambda n: posed_on_page(seed=n), 3),
        camera=Use(lambda c: posed_on_page(focal=focal(c)), CAMERA),
        mesh=Use(lambda m: posed_on_page(mesh=m), MESH),
        tolerance=0.05,
    ),
    column(
        "nablahog invert",
        size=size(lambda s: inverted(image_size=s)),
        number=number(lambda n: inverted(image_size=SIZE, seed=n), 3),
        name=name(lambda n: inverted(image_size=SIZE, preset=n)),
        tolerance=EIGHT_BITS,
    ),
    column(
        "page /api/invert",
        size=size(lambda s: inverted_on_page(s)),
        number=number(lambda n: inverted_on_page(seed=n), 3),
        tolerance=EIGHT_BITS,
    ),
]
