"""The command and the lines of Python that do what the page did, with the user's own files."""

from __future__ import annotations

import math
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cli.arguments.presets import SpecOptions, as_text
from ..cli.inputs.arrays import ArrayOptions
from ..cli.inputs.sources import Source
from ..invert.choices import QualityName
from ..io.descriptor_file import fit
from .requests import HogRequest, InvertRequest, PoseRequest, spec_options


@dataclass(frozen=True)
class Reading:
    """How a file of a descriptor or template is read: its name, the options of the command, and the lines of Python.

    The lines make ``descriptor``, or ``weights``, ``spec`` and ``size``, the (height, width) of the image.
    """

    file: str
    options: tuple[str, ...]
    python: tuple[str, ...]


def of_file(name: str) -> Reading:
    """The reading of a file that ``save_descriptor`` wrote."""
    python = (
        "import nablahog",
        f"stored = nablahog.load_descriptor({name!r})",
        "descriptor, spec, size = stored.descriptor, stored.spec, stored.image_size",
    )
    return Reading(name, (), python)


def of_model(name: str, number: int) -> Reading:
    """The reading of one filter of a voc-release5 model."""
    python = (
        "import nablahog",
        "from nablahog.io.dpm_file import load_dpm",
        f"model = load_dpm({name!r})",
        f"spec, weights = nablahog.presets.dpm(model.cell_size), model.filters[{number}].weights",
        "size = spec.image_size(*weights.shape[:2])",
    )
    return Reading(name, (), python)


def of_array(
    name: str,
    array: NDArray[np.floating],
    source: Source,
    options: SpecOptions,
    arrays: ArrayOptions,
    *,
    template: bool,
) -> Reading:
    """The reading of another library's array, read as ``source``; a bias may follow a template's weights."""
    size, spec = source.image_size, source.spec
    shapes = (array.shape, (array.size,), (array.size - 1,))
    how = next(each for each in (fit(shape, spec, size) for shape in shapes) if each is not None)
    of_preset = options.preset is not None
    laid_out = "spec" if how.layout == spec.layout else f"dataclasses.replace(spec, layout={how.layout!r})"
    count = math.prod(how.shape)
    cut = f".ravel()[:{count}]" if count < array.size else ""
    folded = "" if how.shape in (array.shape, (count,) if cut else ()) else f".reshape({how.shape})"
    single = "" if array.dtype == np.float32 else ".astype('float32')"  # as the page and the command compute
    made = "weights" if template else "descriptor"
    python = (
        "import nablahog" if laid_out == "spec" else "import dataclasses, nablahog",
        "from nablahog.io.arrays import read_array",
        f"array = read_array({name!r}, {arrays.key!r}){cut}{folded}{single}",
        f"spec = {_preset(options) if of_preset else f'nablahog.HOGSpec.from_json({spec.to_json()!r})'}",
        f"size = {size}  # height, width",
        f"{made} = nablahog.from_layout(array, {laid_out}, size)",
    )
    command = _options(options.preset or "", dict(options.settings)) if of_preset else []
    command += ["--image-size", as_text(arrays.image_size)] if arrays.image_size else []
    command += ["--key", arrays.key] if arrays.key else []
    return Reading(name, tuple(command), python)


def for_hog(request: HogRequest, photo: str) -> dict[str, str]:
    """The lines for the descriptor of a photograph."""
    options = [*_options(request.preset, request.settings), "--size", str(request.size)]
    command = _command("hog", photo, "-o", f"{_stem(photo)}.npz", *options)
    return {"command": command, "python": "\n".join(_described(request, photo))}


def for_glyphs(reading: Reading, *, template: bool) -> dict[str, str]:
    """The lines for a picture of a descriptor from a file; of a template, whose glyphs no command draws, pre-images."""
    command = _command("glyph", reading.file, "-o", f"{_stem(reading.file)}_glyphs.png", *reading.options)
    if template:
        command = _command("invert", reading.file, "--template", "-o", "out", *reading.options)
    drawn = f"picture = nablahog.glyphs({'weights' if template else 'descriptor'}, spec)  # (height, width) in 0…1"
    return {"command": command, "python": "\n".join((*reading.python, drawn))}


def for_template(request: InvertRequest, reading: Reading) -> dict[str, str]:
    """The lines for the pre-image of a detector's template."""
    seed = ["--seed", str(request.seed)] if request.seed else []
    python = [
        *reading.python,
        "from nablahog.invert import reconstruct_template",
        f"result = reconstruct_template(weights[None], spec, size, seed={request.seed})",
    ]
    command = _command("invert", reading.file, "--template", "-o", "out", *reading.options, *seed)
    return {"command": command, "python": "\n".join(python)}


def for_inversion(request: InvertRequest, of: str | Reading) -> dict[str, str]:
    """The lines for a pre-image of the descriptor of a photograph, or of one from a file."""
    if isinstance(of, str):
        file, options = of, [*_options(request.preset, request.settings), "--size", str(request.size)]
        described = [*_described(request, of), "size = tuple(photo.shape[1:])"]
    else:
        file, options, described = of.file, list(of.options), list(of.python)
    options += ["--quality", request.quality] if request.quality != "best" else []
    options += {"prior": [], "no-prior": ["--prior", "none"], "paper": ["--method", "paper"]}[request.method]
    options += ["--seed", str(request.seed)] if request.seed else []
    arguments = [f"seed={request.seed}", *_keywords(request.method, request.quality)]
    call = f"result = nablahog.reconstruct(descriptor[None], spec, size, {', '.join(arguments)})"
    python = [*described, call, "print(result.image.shape, result.distance)"]
    again = "" if request.start is None else "# from the beginning, not from the image that the page continued from\n"
    return {
        "command": again + _command("invert", file, "-o", "out", *options),
        "python": again + "\n".join(python),
    }


@dataclass(frozen=True)
class FitFiles:
    """The files of a fit: the photograph, whether it says its focal length, and the mesh, with its axes."""

    photo: str
    says_focal: bool
    mesh: str
    up: str | None = None
    front: str | None = None


def for_pose(request: PoseRequest, files: FitFiles) -> dict[str, str]:
    """The lines for a fit."""
    chair = re.fullmatch(r"chair-([a-z]+-\d+)", request.mesh)
    axes = {name: axis for name, axis in (("up", files.up), ("front", files.front)) if axis}
    options = [] if request.box is None else ["--box", ",".join(f"{side:g}" for side in request.box)]
    options += [f"--{name}={axis}" for name, axis in axes.items()]
    options += [] if request.initial is None else [f"--init={','.join(f'{angle:g}' for angle in request.initial)}"]
    options += (
        ["--focal", f"{request.focal:g}"] if request.focal else ["--focal", "unknown"] if files.says_focal else []
    )
    options += [] if request.method == "best" else ["--method", request.method]
    options += ["--seed", str(request.seed)] if request.seed else []
    parameters = {"box": request.box, "initial": request.initial}
    keywords = [f"{name}={tuple(value)}" for name, value in parameters.items() if value is not None]
    keywords += [f"focal={request.focal:g}"] if request.focal else []
    keywords += [f"method={request.method!r}", *([f"seed={request.seed}"] if request.seed else [])]
    loaded = ", ".join([repr(files.mesh), *(f"{name}={axis!r}" for name, axis in axes.items())])
    python = [
        "import nablahog",
        "from nablahog.io.images import read_image",
        f"photo = read_image({files.photo!r})",
        f"mesh = nablahog.sample_chairs()[{chair[1]!r}]" if chair else f"mesh = nablahog.load_mesh({loaded})",
        f"pose = nablahog.estimate_pose({', '.join(['photo', 'mesh', *keywords])})",
        "print(pose)",
    ]
    command = _command("pose", files.photo, "--mesh", _argument(files.mesh), "-o", "out", *options)
    if chair:
        command = "# the chairs that come with nablahog have no file: see the lines of Python"
    return {"command": command, "python": "\n".join(python)}


def _command(name: str, file: str, *words: str) -> str:
    return shlex.join(["nablahog", name, _argument(file), *words])


def _argument(file: str) -> str:
    """A file's name that the command takes neither for an option nor for a list of files."""
    return f"./{file}" if file[:1] in ("-", "@") else file


def _stem(file: str) -> str:
    return _argument(Path(file).stem)


def _options(preset: str, settings: dict[str, str]) -> list[str]:
    options = ["--preset", preset]
    for name, value in settings.items():
        options += ["--set", f"{name}={value}"]
    return options


def _preset(options: SpecOptions) -> str:
    parameters = {**({"cell_size": 8} if options.preset == "aubry" else {}), **options.parameters()}
    return f"nablahog.presets.{options.preset}({', '.join(f'{name}={value!r}' for name, value in parameters.items())})"


def _described(request: HogRequest | InvertRequest, photo: str) -> list[str]:
    return [
        "import nablahog",
        "from nablahog.io.images import read_image",
        f"photo = read_image({photo!r}, {request.size})  # at most {request.size} pixels on the longer side",
        f"spec = {_preset(spec_options(request.preset, request.settings))}",
        "descriptor = nablahog.hog(photo[None], spec)[0]",
    ]


def _keywords(method: str, quality: QualityName) -> list[str]:
    if method == "paper":
        return ["method='paper'"]
    return [
        *(["prior=None"] if method == "no-prior" else []),
        *([f"quality={quality!r}"] if quality != "best" else []),
    ]
