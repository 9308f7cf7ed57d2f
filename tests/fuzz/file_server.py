"""A process that reads files for :mod:`.files`, one after the other, and says how each ended.

Lines of JSON: in, the name of a reader and a path; out, the outcome, the message, and what it took.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nablahog import HOGSpec
from nablahog.cli.inputs.arrays import ArrayOptions
from nablahog.cli.inputs.spec import SpecOptions
from nablahog.cli.inputs.templates import read_templates
from nablahog.compat.opencv import HOGDescriptor
from nablahog.io.arrays import is_raw
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import read_image
from nablahog.paper.exemplar_views import ExemplarViews
from nablahog.paper.learned import LEARNED
from nablahog.paper.pascal3d import read_record
from nablahog.paper.viewpoints import read_viewpoints
from nablahog.paper.voc import read_annotation, read_image_ids
from nablahog.pose.whitening import Background
from nablahog.render import load_mesh

SPARE = 3 * 2**30  # bytes of addresses beyond those at the start: above any limit, and the machine survives


def _descriptor(path: Path) -> object:
    """As the command reads an input."""
    if is_raw(path):
        return ArrayOptions().read(str(path), SpecOptions("uoctti"))
    return load_descriptor(path)


def _image_ids(path: Path) -> object:
    folder = path.parent / "ImageSets" / "Main"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "chair_val.txt").write_bytes(path.read_bytes())
    return read_image_ids(path.parent, "chair", "val")


READERS: dict[str, Callable[[Path], object]] = {
    "image": read_image,
    "descriptor": _descriptor,
    "template": lambda path: read_templates(str(path), SpecOptions(), ArrayOptions()),
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


def _memory(what: str) -> int:
    """VmSize, VmRSS or VmHWM of this process, in bytes."""
    with open("/proc/self/status") as file:
        return next(1024 * int(line.split()[1]) for line in file if line.startswith(what))


def _answer(reader: str, path: Path) -> dict[str, Any]:
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")  # the peak of memory begins here
    before, began = _memory("VmRSS"), time.process_time()
    outcome, message = "read", ""
    try:
        READERS[reader](path)
    except (ValueError, OSError) as error:
        outcome, message = "refused", str(error)
    except MemoryError:
        outcome, message = "hung", "asked for more than all memory"
    except BaseException as error:
        outcome = "hung" if "allocate memory" in str(error) else "crashed"
        message = "".join(traceback.format_exception(error)[-4:])
    seconds = time.process_time() - began
    return {"outcome": outcome, "message": message, "seconds": seconds, "bytes": _memory("VmHWM") - before}


def serve() -> None:
    """Answers until its input ends; what libraries print goes nowhere."""
    answers = os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    warnings.simplefilter("ignore")
    with contextlib.suppress(ImportError):
        import scipy.spatial  # noqa: F401
        import trimesh  # noqa: F401  # else the first mesh pays for it
    resource.setrlimit(resource.RLIMIT_AS, (_memory("VmSize") + SPARE,) * 2)
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        reader, path = json.loads(line)
        print(json.dumps(_answer(reader, Path(path))), file=answers, flush=True)


if __name__ == "__main__":
    serve()
