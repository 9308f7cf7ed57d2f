"""The command and the lines of Python that do what the page did, with the user's own files."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..io.descriptor_file import find_layout
from ..requests.inversion import GlyphRequest, HogRequest, InvertRequest
from ..requests.options import keywords, words
from ..requests.pose import PoseRequest
from ..requests.sources import Source


@dataclass(frozen=True)
class Reading:
    """How a file of a descriptor or template is read: its name, the options of the command, and lines of Python.

    The Python makes ``descriptor``, or ``weights``, ``spec`` and ``size``, the (height, width) of the image.
    """

    file: str
    options: tuple[str, ...]
    python: tuple[str, ...]


def write_file_reading(name: str) -> Reading:
    """The reading of a file that ``save_descriptor`` wrote."""
    python = (
        "import nablahog",
        f"stored = nablahog.load_descriptor({name!r})",
        "descriptor, spec, size = stored.descriptor, stored.spec, stored.image_size",
    )
    return Reading(name, (), python)


def write_model_reading(name: str, number: int) -> Reading:
    """The reading of one filter of a voc-release5 model."""
    python = (
        "import nablahog",
        "from nablahog.io.dpm_file import load_dpm",
        f"model = load_dpm({name!r})",
        f"spec, weights = nablahog.presets.dpm(model.cell_size), model.filters[{number}].weights",
        "size = spec.image_size(*weights.shape[:2])",
    )
    return Reading(name, (), python)


def write_detector_reading(name: str) -> Reading:
    """The reading of a HOGDescriptor that OpenCV saved."""
    python = (
        "import nablahog",
        "from nablahog.compat.opencv import HOGDescriptor",
        "detector = HOGDescriptor()",
        f"detector.load({name!r})",
        "spec, size = detector.spec, detector.winSize[::-1]  # height, width",
        "weights = nablahog.from_layout(detector.svmDetector[: detector.getDescriptorSize()], spec, size)",
    )
    return Reading(name, (), python)


def write_array_reading(
    name: str, array: NDArray[np.floating], source: Source, request: GlyphRequest, *, template: bool
) -> Reading:
    """The reading of another library's array, read as ``source``; a bias may follow a template's weights."""
    size, spec, row = source.image_size, source.spec, ""
    if request.row is not None:
        array, row = array[request.row], f"[{request.row}]"
    shapes = (array.shape, (array.size,), (array.size - 1,))
    layouts = (find_layout(shape, spec, size) for shape in shapes)
    how = next(layout for layout in layouts if layout is not None)
    laid_out = "spec" if how.layout == spec.layout else f"dataclasses.replace(spec, layout={how.layout!r})"
    count = math.prod(how.shape)
    cut = f".ravel()[:{count}]" if count < array.size else ""
    folded = "" if how.shape in (array.shape, (count,) if cut else ()) else f".reshape({how.shape})"
    single = "" if array.dtype == np.float32 else ".astype('float32')"  # as the page and the command compute
    python = (
        "import nablahog" if laid_out == "spec" else "import dataclasses, nablahog",
        "from nablahog.io.arrays import read_array",
        f"array = read_array({name!r}, {request.key!r}){row}{cut}{folded}{single}",
        f"spec = {request.python if request.preset else f'nablahog.HOGSpec.from_json({spec.to_json()!r})'}",
        f"size = {size}  # height, width",
        f"{'weights' if template else 'descriptor'} = nablahog.from_layout(array, {laid_out}, size)",
    )
    return Reading(name, tuple(words(request, GlyphRequest)), python)


def write_hog_snippets(request: HogRequest, photo: str) -> dict[str, str]:
    """Returns the command and the Python for the descriptor of a photograph."""
    command = _command("hog", photo, "-o", f"{_stem(photo)}.npz", *words(request, HogRequest))
    return {"command": command, "python": "\n".join(_write_description(request, photo))}


def write_glyph_snippets(reading: Reading, *, template: bool) -> dict[str, str]:
    """Returns those for glyphs of a descriptor from a file; of a template, which no command draws, for pre-images."""
    command = _command("glyph", reading.file, "-o", f"{_stem(reading.file)}_glyphs.png", *reading.options)
    if template:
        command = _command("invert", reading.file, "-o", "out", *reading.options, "--template")
    drawn = f"picture = nablahog.glyphs({'weights' if template else 'descriptor'}, spec)  # (height, width) in 0…1"
    return {"command": command, "python": "\n".join((*reading.python, drawn))}


def write_inversion_snippets(request: InvertRequest, source: str | Reading) -> dict[str, str]:
    """Returns those for a pre-image of the descriptor of a photograph, or of a descriptor or template from a file."""
    if isinstance(source, str):
        file, options = source, words(request, InvertRequest)
        described = [*_write_description(request, source), "size = tuple(photo.shape[1:])"]
    else:
        file, options = source.file, [*source.options, *words(request, InvertRequest, beyond=GlyphRequest)]
        described = list(source.python)
    asked = _arguments(request.keywords())
    if request.template:
        imported = "from nablahog.invert import reconstruct_template"
        call = [imported, f"result = reconstruct_template(weights[None], spec, size{asked})"]
    else:
        call = [f"result = nablahog.reconstruct(descriptor[None], spec, size{asked})"]
    python = [*described, *call, "print(result.image.shape, result.distance)"]
    return {"command": _command("invert", file, "-o", "out", *options), "python": "\n".join(python)}


@dataclass(frozen=True)
class FitFiles:
    """The files of a fit: the photograph, whether it says its focal length, and the mesh, with its axes.

    ``chair`` is the name of the mesh if it comes with the package, and so has no file.
    """

    photo: str
    says_focal: bool
    mesh: str
    up: str | None = None
    front: str | None = None
    chair: str | None = None


def write_pose_snippets(request: PoseRequest, files: FitFiles) -> dict[str, str]:
    """Returns those for a fit."""
    axes = {name: axis for name, axis in (("up", files.up), ("front", files.front)) if axis}
    mesh = f"nablahog.load_mesh({files.mesh!r}{_arguments(axes)})"
    python = [
        "import nablahog",
        "from nablahog.io.images import read_image",
        f"photo = read_image({files.photo!r})",
        f"mesh = nablahog.sample_chairs()[{files.chair!r}]" if files.chair else f"mesh = {mesh}",
        f"pose = nablahog.estimate_pose(photo, mesh{_arguments(keywords(request, PoseRequest))})",
        "print(pose)",
    ]
    focal = "unknown" if request.focal is None and files.says_focal else request.focal
    asked = replace(request, mesh=_argument(files.mesh), up=files.up, front=files.front, focal=focal)
    command = _command("pose", files.photo, "-o", "out", *words(asked, PoseRequest))
    if files.chair:
        command = "# the chairs that come with nablahog have no file: see the lines of Python"
    return {"command": command, "python": "\n".join(python)}


def _command(name: str, file: str, *options: str) -> str:
    return shlex.join(["nablahog", name, _argument(file), *options])


def _argument(file: str) -> str:
    """A file's name that the command takes neither for an option nor for a list of files."""
    return f"./{file}" if file[:1] in ("-", "@") else file


def _stem(file: str) -> str:
    return _argument(Path(file).stem)


def _arguments(values: Mapping[str, object]) -> str:
    """Keywords of a call, after its other arguments."""
    return "".join(f", {name}={value!r}" for name, value in values.items())


def _write_description(request: HogRequest, photo: str) -> list[str]:
    return [
        "import nablahog",
        "from nablahog.io.images import read_image",
        f"photo = read_image({photo!r}, {request.size})  # at most {request.size} pixels on the longer side",
        f"spec = {request.python}",
        "descriptor = nablahog.hog(photo[None], spec)[0]",
    ]
