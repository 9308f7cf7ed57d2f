"""How many functions of the package run for a call, and in how many files?

    python benchmarks/traces.py [hog reconstruct pose invert table2] [--list]

Counts the functions of ``nablahog`` that Python enters, in all threads, once each; comprehensions and generator
expressions count for the function that has them.  Each program runs twice in a process of its own, and the functions of
the second run are counted: what only a first call does is left out.  Files are those of these functions; files loaded
are all that the process has imported.  Jobs run in a thread in place of a process.

| program | what is counted |
|---|---|
| hog | ``hog(x, "uoctti")`` of 16 x 16 pixels, and its backward pass |
| reconstruct | an image with the scikit-image descriptor of one of 64 x 64 pixels |
| pose | ``nablahog pose --page`` with one model and a box |
| invert | ``POST /api/invert`` of a photograph of 64 x 48 pixels |
| table2 | ``nablahog table2`` of one scene, all methods, without the second table |
"""

from __future__ import annotations

import argparse
import concurrent.futures
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import torch
from PIL import Image


class Threads(ThreadPoolExecutor):
    """A ThreadPoolExecutor with the arguments of a ProcessPoolExecutor."""

    _processes: dict[int, Any] = {}  # noqa: RUF012

    def __init__(self, workers: int, *_: Any, **__: Any) -> None:
        super().__init__(workers)


concurrent.futures.ProcessPoolExecutor = Threads  # type: ignore[assignment, misc]  # before the package imports it

import nablahog  # noqa: E402
from nablahog.cli.main import main  # noqa: E402
from nablahog.render import Camera, pose, render  # noqa: E402

PACKAGE = Path(nablahog.__file__).parent
COMPREHENSIONS = ("<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>", "<module>")
HOST = "127.0.0.1:8765"


@contextmanager
def traced(entered: set[CodeType]) -> Iterator[None]:
    """Adds the code of all functions of the package that are entered in the block, in this and in new threads."""
    package = str(PACKAGE) + os.sep

    def enter(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(package) and code.co_name not in COMPREHENSIONS:
            entered.add(code)

    threading.setprofile(enter)
    sys.setprofile(enter)
    try:
        yield
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def run(*arguments: str) -> None:
    if main([*arguments, "--quiet"]) not in (0, 4):  # 4: less sure than asked for
        raise RuntimeError(f"nablahog {' '.join(arguments)} failed")


def smooth_image() -> torch.Tensor:
    coarse = torch.rand(1, 1, 8, 8, generator=torch.Generator().manual_seed(0))
    return torch.nn.functional.interpolate(coarse, size=(64, 64), mode="bicubic").clamp(0, 1)


def describe(folder: Path) -> set[CodeType]:
    """``hog`` and its backward pass."""
    images, entered = smooth_image()[..., :16, :16].requires_grad_(), set[CodeType]()
    with traced(entered):
        nablahog.hog(images, "uoctti").sum().backward()
    return entered


def reconstruct(folder: Path) -> set[CodeType]:
    """``reconstruct`` of an unsigned descriptor."""
    descriptor, entered = nablahog.hog(smooth_image(), "skimage"), set[CodeType]()
    with traced(entered):
        nablahog.reconstruct(descriptor, "skimage", image_size=(64, 64), seed=0)
    return entered


def find_pose(folder: Path) -> set[CodeType]:
    """``nablahog pose`` of a rendered chair."""
    photo, mesh = folder / "scene.png", folder / "chair.off"
    chair = nablahog.sample_chairs()["wooden-0"]
    rendering = render(chair, pose(35, 20, 2.5), Camera.from_field_of_view(45, 96, 96))
    Image.fromarray((255 * rendering[0, 0]).byte().numpy()).save(photo)
    vertices, faces = chair.vertices.tolist(), chair.faces.tolist()
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0", *(" ".join(map(str, vertex)) for vertex in vertices)]
    mesh.write_text("\n".join(lines + [f"3 {' '.join(map(str, face))}" for face in faces]))
    entered: set[CodeType] = set()
    with tempfile.TemporaryDirectory() as out, traced(entered):
        run("pose", str(photo), "--mesh", str(mesh), "--box", "10,10,86,86", "--page", "--workers", "1", "-o", out)
    return entered


def post_invert(folder: Path) -> set[CodeType]:
    """``POST /api/invert``."""
    from starlette.testclient import TestClient

    from nablahog.app.access import AccessRules
    from nablahog.app.server import make_app

    photo, entered = folder / "photo.png", set[CodeType]()
    Image.fromarray((255 * smooth_image()[0, 0, :, :48]).byte().numpy()).save(photo)
    with TestClient(make_app(AccessRules(frozenset({HOST}), None)), base_url=f"http://{HOST}") as client:
        photo_id = client.post("/api/photos?name=photo.png", content=photo.read_bytes()).json()["id"]
        for _ in range(2):
            entered.clear()
            with traced(entered):
                client.post("/api/invert", json={"photo": photo_id, "preset": "uoctti"}).raise_for_status()
    return entered


def fill_table2(folder: Path) -> set[CodeType]:
    """``nablahog table2`` of one scene."""
    entered: set[CodeType] = set()
    with tempfile.TemporaryDirectory() as out, traced(entered):
        run("table2", "--objects", "1", "--conditions", "none", "--workers", "1", "-o", out)
    return entered


PROGRAMS: dict[str, Callable[[Path], set[CodeType]]] = {
    "hog": describe,
    "reconstruct": reconstruct,
    "pose": find_pose,
    "invert": post_invert,
    "table2": fill_table2,
}


def count(name: str, show_functions: bool) -> None:
    """Prints a row of the table, and each file with its functions if asked for."""
    with tempfile.TemporaryDirectory() as folder:
        PROGRAMS[name](Path(folder))
        entered = PROGRAMS[name](Path(folder))
    functions: dict[str, list[str]] = {}
    for code in entered:
        functions.setdefault(Path(code.co_filename).relative_to(PACKAGE).as_posix(), []).append(code.co_name)
    loaded = {module.__file__ for name, module in sys.modules.items() if name.split(".")[0] == "nablahog"}
    print(f"| {name} | {len(entered)} | {len(functions)} | {len(loaded)} |", flush=True)
    for file in sorted(functions) if show_functions else ():
        print(f"  {file}: {', '.join(sorted(functions[file]))}")


def command_line() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", metavar="PROGRAM", help=f"of {', '.join(PROGRAMS)} (default: all)")
    parser.add_argument("--list", action="store_true", help="print each file with its functions, too")
    arguments = parser.parse_args()
    if len(arguments.programs) == 1:
        return count(arguments.programs[0], arguments.list)
    print("| program | functions | files | files loaded |\n|---|---|---|---|", flush=True)
    for name in arguments.programs or PROGRAMS:
        subprocess.run([sys.executable, __file__, name, *["--list"] * arguments.list], check=True)


if __name__ == "__main__":
    command_line()
