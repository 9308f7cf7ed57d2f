"""What answers have in common: pictures and glyphs in JSON, and the command and lines of Python that do the same."""

from __future__ import annotations

import base64
import io
import re
import shlex
from typing import Any

import numpy as np
from torch import Tensor

from ..cli.arguments.presets import SpecOptions
from ..cli.inputs.sources import Source
from ..hog import HOGSpec
from ..invert.choices import QualityName
from ..io.images import Picture, to_pil
from ..viz.pictures import glyph_votes
from .requests import HogRequest, InvertRequest, PoseRequest, spec_options

PHOTO = "photo.png"
DESCRIPTOR = "descriptor.npz"
TEMPLATE = "template.npy"


def png(picture: Picture, opacity: Picture | None = None) -> bytes:
    """A picture in 0…1, with its opacity (H, W) if it is gray, as a PNG file."""
    file, image = io.BytesIO(), to_pil(picture)
    if opacity is not None:
        image.putalpha(to_pil(opacity))
    image.save(file, format="PNG", compress_level=1)  # for the loopback: fast, not small
    return file.getvalue()


def encoded(data: bytes) -> str:
    """Bytes as base64."""
    return base64.b64encode(data).decode("ascii")


def glyphs(descriptor: Tensor, spec: HOGSpec) -> dict[str, Any]:
    """The brightness of each stroke of a descriptor's glyphs (rows, cols, channels), as the page draws them."""
    votes, angles = glyph_votes(descriptor, spec)
    rows, cols, count = votes.shape
    return {
        "rows": rows,
        "cols": cols,
        "n": count,
        "cell": list(spec.cell_size),
        "angles": angles.tolist(),
        "votes": encoded(np.rint(votes * 255).astype(np.uint8).tobytes()),
    }


def lines_for_hog(request: HogRequest, source: Source) -> dict[str, str]:
    """The lines for a descriptor."""
    if source.photo is None:
        return {"command": _command("glyph", DESCRIPTOR, "-o", "glyphs.png"), "python": "\n".join(_stored())}
    command = _command("hog", PHOTO, "-o", DESCRIPTOR, *_options(request), "--size", str(request.size))
    return {"command": command, "python": "\n".join(_described(request))}


def lines_for_template(request: InvertRequest, source: Source) -> dict[str, str]:
    """The lines for the pre-image of a detector's template."""
    seed = ["--seed", str(request.seed)] if request.seed else []
    python = [
        "import nablahog, numpy",
        "from nablahog.invert import reconstruct_template",
        f"weights = numpy.load({TEMPLATE!r})  # (rows, cols, channels) = {tuple(source.descriptor.shape)}",
        f"spec = nablahog.HOGSpec.from_json({source.spec.to_json()!r})",
        f"result = reconstruct_template(weights, spec, {source.image_size}, seed={request.seed})",
    ]
    return {"command": _command("invert", TEMPLATE, "--template", "-o", "out", *seed), "python": "\n".join(python)}


def lines_for_inversion(request: InvertRequest, source: Source) -> dict[str, str]:
    """The lines for a pre-image."""
    own = request.photo is not None
    options = [*(_options(request) if own else []), *(["--size", str(request.size)] if own else [])]
    options += ["--quality", request.quality] if request.quality != "best" else []
    options += {"prior": [], "no-prior": ["--prior", "none"], "paper": ["--method", "paper"]}[request.method]
    options += ["--seed", str(request.seed)] if request.seed else []
    arguments = [f"seed={request.seed}", *_keywords(request.method, request.quality)]
    described = [*_described(request), "size = photo.height, photo.width"] if own else _stored()
    call = f"result = nablahog.reconstruct(descriptor, spec, size, {', '.join(arguments)})"
    python = [*described, call, "print(result.image.shape, result.distance)"]
    return {
        "command": _command("invert", PHOTO if own else DESCRIPTOR, "-o", "out", *options),
        "python": "\n".join(python),
    }


def lines_for_pose(request: PoseRequest, mesh: str) -> dict[str, str]:
    """The lines for a fit."""
    chair = re.fullmatch(r"chair-([a-z]+-\d+)", request.mesh)
    box = [] if request.box is None else ["--box", ",".join(f"{side:g}" for side in request.box)]
    initial = [] if request.initial is None else [f"--init={','.join(f'{angle:g}' for angle in request.initial)}"]
    method = [] if request.method == "best" else ["--method", request.method]
    seed = ["--seed", str(request.seed)] if request.seed else []
    parameters = {"box": request.box, "initial": request.initial}
    keywords = [f"{name}={tuple(value)}" for name, value in parameters.items() if value is not None]
    keywords += [f"method={request.method!r}", *([f"seed={request.seed}"] if request.seed else [])]
    python = [
        "import nablahog, PIL.Image",
        f"photo = PIL.Image.open({PHOTO!r}).convert('RGB')",
        f"mesh = nablahog.sample_chairs()[{chair[1]!r}]" if chair else f"mesh = nablahog.load_mesh({mesh!r})",
        f"pose = nablahog.estimate_pose({', '.join(['photo', 'mesh', *keywords])})",
        "print(pose)",
    ]
    command = _command("pose", PHOTO, "--mesh", mesh, "-o", "out", *box, *initial, *method, *seed)
    if chair:
        command = "# the chairs that come with nablahog have no file: see the lines of Python"
    return {"command": command, "python": "\n".join(python)}


def _command(*words: str) -> str:
    return shlex.join(["nablahog", *words])


def _options(request: HogRequest | InvertRequest) -> list[str]:
    options = ["--preset", request.preset]
    for name, value in request.settings.items():
        options += ["--set", f"{name}={value}"]
    return options


def _described(request: HogRequest | InvertRequest) -> list[str]:
    options: SpecOptions = spec_options(request.preset, request.settings)
    parameters = {**({"cell_size": 8} if request.preset == "aubry" else {}), **options.parameters()}
    settings = ", ".join(f"{name}={value!r}" for name, value in parameters.items())
    return [
        "import nablahog, PIL.Image",
        f"photo = PIL.Image.open({PHOTO!r}).convert('RGB')",
        f"photo.thumbnail(({request.size}, {request.size}))  # nearly as the command shrinks it",
        f"spec = nablahog.presets.{request.preset}({settings})",
        "descriptor = nablahog.hog(photo, spec)",
    ]


def _stored() -> list[str]:
    return [
        "import nablahog",
        f"stored = nablahog.load_descriptor({DESCRIPTOR!r})",
        "descriptor, spec, size = stored.descriptor[None], stored.spec, stored.image_size",
    ]


def _keywords(method: str, quality: QualityName) -> list[str]:
    if method == "paper":
        return ["method='paper'"]
    return [
        *(["prior='default'"] if method == "prior" else []),
        *([f"quality={quality!r}"] if quality != "best" else []),
    ]
