"""``nablahog hog`` saves descriptors, ``nablahog glyph`` draws them."""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from ...io.descriptor_file import save_descriptor
from ...io.files import Writable, forbid_overwrite, output_folder
from ...io.images import image_endings, write_image
from ...requests.inversion import GlyphRequest, HogRequest
from ...requests.sources import Source
from ...viz.pictures import glyph_image
from ..arguments.options import build_request
from ..errors import WrongArguments
from ..input_files import DATASET, Inputs
from ..inputs import read_inputs
from ..terminal import print_table
from .hog_dataset import hog_dataset

STDOUT = "-"
OTHER_FORMATS = (".npy", ".mat", ".csv", ".txt", ".json")  # in which programs would expect what their names say


def hog(arguments: Namespace) -> int:
    """Saves the descriptor of each photograph with its spec, or all as one data set; returns the exit status."""

    if arguments.output.rstrip("/").lower().endswith(DATASET):
        return hog_dataset(arguments)
    for option in ("workers", "cluster"):
        if getattr(arguments, option) is not None:
            raise WrongArguments(f"--{option} goes with a data set: expected -o NAME{DATASET}, got {arguments.output}")

    def write(target: Writable, source: Source) -> None:
        save_descriptor(target, source.descriptor, source.spec, source.image_size)

    is_file = not arguments.output.endswith(os.sep)  # a file of nearly any name, since np.load does not mind
    suffix = Path(arguments.output).suffix.lower()
    if suffix in {*image_endings(), *OTHER_FORMATS} and arguments.output not in arguments.inputs:
        raise WrongArguments(
            f"descriptors are written as .npz, which numpy.load reads: expected -o FILE.npz, a folder or "
            f"NAME{DATASET}, got {arguments.output}"
        )
    _check_stdout(arguments.output)
    inputs = read_inputs(arguments, build_request(HogRequest, arguments))
    _write_files(arguments.output, inputs, ".npz", write, is_file=is_file)
    return inputs.skipping.status


def glyph(arguments: Namespace) -> int:
    """Draws each descriptor; returns the exit status."""

    def write(target: Writable, source: Source) -> None:
        write_image(target, glyph_image(source.descriptor, source.spec))

    suffix = Path(arguments.output).suffix.lower()
    if suffix != ".png" and suffix in Image.registered_extensions():
        raise WrongArguments(f"glyphs are written as PNG: expected -o FILE.png or a folder, got {arguments.output}")
    _check_stdout(arguments.output)
    inputs = read_inputs(arguments, build_request(GlyphRequest, arguments))
    _write_files(arguments.output, inputs, "_glyphs.png", write, is_file=suffix == ".png")
    return inputs.skipping.status


def _check_stdout(output: str) -> None:
    if output == STDOUT and getattr(sys.stdout, "name", "") == os.devnull:
        raise ValueError("-o - writes to stdout, which is closed: expected a pipe or a file")
    if output == STDOUT and sys.stdout.isatty():
        raise ValueError("-o - writes bytes, and stdout is a terminal: expected a pipe or a file")


def _write_files(
    name: str, inputs: Inputs, ending: str, write: Callable[[Writable, Source], None], *, is_file: bool
) -> None:
    """Writes one result for each input: to stdout; to the file ``name``, for one input and ``is_file``; or to a folder.

    Prints a table of what was written, except after writing to stdout.
    """
    output = Path(name)
    to_stdout = name == STDOUT
    if inputs.many and (to_stdout or (output.suffix and ending.endswith(output.suffix.lower()))):
        got = "stdout" if to_stdout else f"the file name {output}"
        raise WrongArguments(f"several inputs need a folder: expected -o DIR, got {got}")
    if to_stdout:
        (source,) = inputs.sources
        write(sys.stdout.buffer, source)
        return
    if not inputs.many and is_file and not output.is_dir():
        folder, targets = output.parent, dict.fromkeys(inputs.stems, output)
    else:
        folder, targets = output, {stem: output / f"{stem}{ending}" for stem in inputs.stems}
    forbid_overwrite(inputs.paths, targets.values())
    rows = []
    with output_folder(folder):
        for source in inputs.sources:
            target = targets.get(source.stem, output / f"{source.stem}{ending}")  # of a row of a matrix
            write(target, source)
            rows.append(
                {
                    "input": source.path,
                    "descriptor": source.spec.name,
                    "image_size": list(source.image_size),
                    "shape": list(source.descriptor.shape),
                    "output": str(target),
                }
            )
    print_table(rows)
