"""The command and the page, which take files and texts."""

from __future__ import annotations

import io
import json
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from starlette.testclient import TestClient

from nablahog.app.access import AccessRules
from nablahog.app.server import make_app
from nablahog.cli.main import main
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import read_image

from ..table import Column, NotApplicable, Told, Use
from .plain import DESCRIPTOR, IMAGE, as_bytes, image, name, number

HOST = "127.0.0.1:8765"
EIGHT_BITS = 0.01  # of pictures in files
TIFF, PNG = ("F", "I", "CMYK", "YCbCr", "LAB"), ("1", "L", "LA", "P", "RGB", "RGBA", "I;16")


def file_of(value: Any) -> tuple[str, bytes]:
    """An image as a file: its ending and its bytes."""
    source = getattr(value, "fp", None)
    if isinstance(value, Image.Image) and isinstance(source, io.BytesIO):  # as it was opened
        return f".{(value.format or 'png').lower()}", source.getvalue()
    if (
        isinstance(value, np.ndarray)
        and value.dtype in (np.uint8, np.uint16, np.float32, bool)
        and value.ndim in (2, 3)
    ):
        if value.ndim == 3 and (value.shape[2] != 3 or value.dtype != np.uint8):
            value = as_bytes(value) if value.shape[2] == 3 and value.dtype == np.float32 else None
        value = None if value is None or np.ma.is_masked(value) else Image.fromarray(np.ascontiguousarray(value))
    if not isinstance(value, Image.Image) or value.mode not in (*TIFF, *PNG):
        raise NotApplicable
    file, form = io.BytesIO(), "TIFF" if value.mode in TIFF else "PNG"
    if not value.width * value.height:
        raise NotApplicable
    value.save(file, format=form)
    return f".{form.lower()}", file.getvalue()


def stored(value: Any) -> tuple[str, bytes]:
    """A descriptor as a file of NumPy or PyTorch."""
    file = io.BytesIO()
    if isinstance(value, np.ndarray):
        np.save(file, value, allow_pickle=True)
        return ".npy", file.getvalue()
    if isinstance(value, torch.Tensor) and not value.is_nested:
        torch.save(value, file)
        return ".pt", file.getvalue()
    raise NotApplicable


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


def as_words(value: Any) -> str:
    if not isinstance(value, str | int | float):
        raise NotApplicable
    return str(value)


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
    ending, data = file_of(value)
    photo = answer(f"/api/photos?name=a{ending}", content=data)["id"]
    return requested({"photo": photo, **asked})


def requested(asked: dict[str, Any]) -> Any:
    try:
        body = json.dumps({"preset": "uoctti", **asked})
    except TypeError:
        raise NotApplicable from None
    key = answer("/api/hog", content=body)["key"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "d.npz")
        path.write_bytes(client().get(f"/api/hog/{key}/file").content)
        return load_descriptor(path).descriptor


def uploaded(value: Any) -> Any:
    ending, data = stored(value)
    return requested({"descriptor": answer(f"/api/descriptors?name=d{ending}&preset=uoctti", content=data)["id"]})


COLUMNS = [
    Column(
        "command",
        {
            "image": image(described),
            "descriptor": Use(pictured, DESCRIPTOR[0], lambda d: d.numpy()),
            "name": name(lambda n: described(IMAGE, "--preset", as_words(n))),
            "number": number(lambda n: described(IMAGE, f"--size={as_words(n)}"), 32),
        },
        tolerance=1e-3,
        types=(np.ndarray, Image.Image),
    ),
    Column(
        "page",
        {
            "image": image(on_page),
            "descriptor": Use(uploaded, DESCRIPTOR[0], lambda d: d.numpy()),
            "name": name(lambda n: on_page(IMAGE, preset=n)),
            "number": number(lambda n: on_page(IMAGE, size=n), 32),
        },
        tolerance=1e-3,
        types=(np.ndarray, Image.Image),
    ),
]
