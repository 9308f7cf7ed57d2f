"""``nablahog hog`` saves descriptors, ``nablahog glyph`` draws them."""

from __future__ import annotations

import json
import os
import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from ...io.descriptor_file import save_descriptor
from ...io.files import output_folder
from ...io.images import write_image
from ...viz.pictures import glyph_image
from ..errors import UserError, forbid_overwrite
from ..inputs.sources import DATASET, Inputs, Source, read_inputs
from ..terminal import print_table
from .hog_dataset import hog_dataset

STDOUT = "-"


def hog(arguments: Namespace) -> int:
    """Saves the descriptor of each photograph with its spec, or all as one data set; returns the exit status."""

    if arguments.output.rstrip("/").lower().endswith(DATASET):
        return hog_dataset(arguments)
    for option in ("workers", "cluster"):
        if getattr(arguments, option) is not None:
            raise UserError(f"--{option} goes with a data set: expected -o NAME{DATASET}, got {arguments.output}")
    if arguments.output == STDOUT and arguments.json:
        raise UserError("-o - and --json would both write to stdout: expected one of them")

    def write(path: Path, source: Source) -> None:
        save_descriptor(path, source.descriptor, source.spec, source.image_size)

    is_file = not arguments.output.endswith(os.sep)  # a file of any name, since np.load does not mind
    _check_stdout(arguments.output)
    inputs = read_inputs(arguments, arrays=False)
    rows = _write_each(arguments.output, inputs, ".npz", write, is_file=is_file)
    if arguments.json:
        print(json.dumps([*rows, *inputs.skipping.skipped], indent=2))
    elif rows:
        print_table(rows)
    return inputs.skipping.status


def glyph(arguments: Namespace) -> int:
    """Draws each descriptor; returns the exit status."""

    def write(path: Path, source: Source) -> None:
        write_image(path, glyph_image(source.descriptor, source.spec))

    suffix = Path(arguments.output).suffix.lower()
    if suffix != ".png" and suffix in Image.registered_extensions():
        raise UserError(f"glyphs are written as PNG: expected -o FILE.png or a folder, got {arguments.output}")
    _check_stdout(arguments.output)
    inputs = read_inputs(arguments)
    rows = _write_each(arguments.output, inputs, "_glyphs.png", write, is_file=suffix == ".png")
    if rows:
        print_table(rows)
    return inputs.skipping.status


def _check_stdout(output: str) -> None:
    if output == STDOUT and sys.stdout.isatty():
        raise UserError("-o - writes bytes, and stdout is a terminal: expected a pipe or a file")


def _write_each(
    name: str, inputs: Inputs, ending: str, write: Callable[[Path, Source], None], *, is_file: bool
) -> list[dict[str, object]]:
    """Writes one result for each input: to stdout, the file ``name`` if one input and ``is_file``, or a folder.

    Returns what was written, for a table; nothing of stdout.
    """
    output, sources = Path(name), inputs.sources
    to_stdout = name == STDOUT
    if inputs.many and (to_stdout or (output.suffix and ending.endswith(output.suffix.lower()))):
        got = "stdout" if to_stdout else f"the file name {output}"
        raise UserError(f"several inputs need a folder: expected -o DIR, got {got}")
    if to_stdout:
        with TemporaryDirectory(prefix="nablahog-stdout-") as temporary:
            write(result := Path(temporary, "result"), sources[0])
            sys.stdout.buffer.write(result.read_bytes())
        return []
    if not inputs.many and is_file and not output.is_dir():
        folder, targets = output.parent, [output]
    else:
        folder, targets = output, [output / f"{source.stem}{ending}" for source in sources]
    forbid_overwrite(inputs.paths, targets)
    with output_folder(folder):
        for target, source in zip(targets, sources, strict=True):
            write(target, source)
    return [
        {
            "input": source.path,
            "descriptor": source.spec.name,
            "image_size": list(source.image_size),
            "shape": list(source.descriptor.shape),
            "output": str(target),
        }
        for target, source in zip(targets, sources, strict=True)
    ]
