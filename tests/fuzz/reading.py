"""Reads files one after the other in a process of its own, under limits of time and memory, and says how each ended."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
import traceback
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import scipy.spatial  # noqa: F401  else the first that needs it pays for it

from nablahog import HOGSpec
from nablahog.compat.opencv import HOGDescriptor
from nablahog.io.arrays import is_raw
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import read_image
from nablahog.paper.annotations import read_viewpoints
from nablahog.paper.baselines.exemplar_views import ExemplarViews
from nablahog.paper.learned import LEARNED
from nablahog.paper.pascal3d import read_record
from nablahog.paper.voc import read_annotation, read_image_ids
from nablahog.pose.whitening import Background
from nablahog.render import load_mesh
from nablahog.requests.arrays import read_stored
from nablahog.requests.inversion import GlyphRequest
from nablahog.requests.templates import read_templates

SPARE = 3 * 2**30  # bytes of addresses beyond those at the start: above any limit, and the machine survives
PATIENCE = 30.0  # seconds on the clock, after which a reader waits for something that never comes
START = 300.0  # seconds until it has imported everything


def _descriptor(path: Path) -> object:
    """As the command reads an input."""
    return read_stored(str(path), GlyphRequest(preset="uoctti")) if is_raw(path) else load_descriptor(path)


def _image_ids(path: Path) -> object:
    folder = path.parent / "ImageSets" / "Main"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "chair_val.txt").write_bytes(path.read_bytes())
    return read_image_ids(path.parent, "chair", "val")


READERS: dict[str, Callable[[Path], object]] = {
    "image": read_image,
    "descriptor": _descriptor,
    "template": lambda path: read_templates(str(path), GlyphRequest()),
    "mesh": load_mesh,
    "record": read_record,
    "viewpoints": read_viewpoints,
    "annotation": read_annotation,
    "image_ids": _image_ids,
    "spec": lambda path: HOGSpec.from_json(path.read_bytes().decode("utf-8", "surrogateescape")),
    "storage": lambda path: HOGDescriptor().load(path),
    "background": Background.load,
    "views": ExemplarViews.load,
    **{kind: learner.model.load for kind, learner in LEARNED.items()},
}


class Answer(NamedTuple):
    """``read``, ``refused`` or ``crashed``, in which words, and what it took: seconds of the processor, and bytes."""

    outcome: str
    message: str = ""
    seconds: float = 0.0
    bytes: int = 0


def _memory(what: str) -> int:
    """VmSize, VmRSS or VmHWM of this process, in bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(what))


def _answer(reader: str, path: Path) -> Answer:
    Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins here
    before, began = _memory("VmRSS"), time.process_time()
    outcome, message = "read", ""
    try:
        READERS[reader](path)
    except (ValueError, OSError) as error:
        outcome, message = "refused", str(error)
    except BaseException as error:
        outcome, message = "crashed", "".join(traceback.format_exception(error)[-4:])
    return Answer(outcome, message, time.process_time() - began, _memory("VmHWM") - before)


def serve(pipe: Connection) -> None:
    """Answers as long as somebody asks; what libraries print goes nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (_memory("VmSize") + SPARE,) * 2)
    pipe.send("ready")
    while True:
        pipe.send(_answer(*pipe.recv()))


class Reader:
    """The process, which is used again until it dies."""

    def __init__(self) -> None:
        self.process: Any = None

    def read(self, reader: str, path: Path) -> Answer:
        """``crashed`` if the process ends, and ``hung`` if it says nothing for long."""
        if self.process is None:
            forking = multiprocessing.get_context("spawn")
            self.pipe, theirs = forking.Pipe()
            self.process = forking.Process(target=serve, args=(theirs,), daemon=True)
            self.process.start()
            theirs.close()
            assert self.pipe.poll(START)
            self.pipe.recv()
        try:
            self.pipe.send((reader, path))
            if self.pipe.poll(PATIENCE):
                answer: Answer = self.pipe.recv()
                return answer
            outcome = "hung"
        except (EOFError, ConnectionError):
            outcome = "crashed"
        self.process.kill()
        self.process.join()
        status, self.process = self.process.exitcode, None
        return Answer(outcome, f"the process ended with status {status}")
