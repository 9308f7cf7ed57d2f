"""``nablahog hog`` saves descriptors, ``nablahog glyph`` draws them."""

from __future__ import annotations

import json
import os
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path

from PIL import Image

from ...io.descriptor_file import save_descriptor
from ...io.files import output_folder
from ...io.images import write_image
from ...viz.pictures import glyphs
from ..errors import UserError, as_user_error, forbid_overwrite
from ..inputs.memory import check_glyphs
from ..inputs.sources import Source, read_sources
from ..terminal import print_table


def hog(arguments: Namespace) -> None:
    """Saves the descriptor of each photograph with its spec.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """

    def write(path: Path, source: Source) -> None:
        save_descriptor(path, source.descriptor, source.spec, source.image_size)

    is_file = not arguments.output.endswith(os.sep)  # a file of any name, since np.load does not mind
    _write_each(arguments, read_sources(arguments, arrays=False), ".npz", write, is_file=is_file)


def glyph(arguments: Namespace) -> None:
    """Draws each descriptor.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """

    def write(path: Path, source: Source) -> None:
        write_image(path, glyphs(source.descriptor, source.spec))

    suffix = Path(arguments.output).suffix.lower()
    if suffix != ".png" and suffix in Image.registered_extensions():
        raise UserError(f"glyphs are written as PNG: expected -o FILE.png or a folder, got {arguments.output}")
    sources = read_sources(arguments)
    with as_user_error():
        for source in sources:
            check_glyphs(source.path, tuple(source.descriptor.shape), source.spec, arguments.memory)
    _write_each(arguments, sources, "_glyphs.png", write, is_file=suffix == ".png")


def _write_each(
    arguments: Namespace,
    sources: Sequence[Source],
    ending: str,
    write: Callable[[Path, Source], None],
    *,
    is_file: bool,
) -> None:
    """Writes one result for each input: to the file ``-o`` if one input and ``is_file``, else to a folder."""
    output = Path(arguments.output)
    if len(sources) > 1 and output.suffix and ending.endswith(output.suffix.lower()):
        raise UserError(f"several inputs need a folder: expected -o DIR, got the file name {output}")
    if len(sources) == 1 and is_file and not output.is_dir():
        folder, targets = output.parent, [output]
    else:
        folder, targets = output, [output / f"{source.stem}{ending}" for source in sources]
    forbid_overwrite(arguments.inputs, targets)
    with output_folder(folder):
        for target, source in zip(targets, sources, strict=True):
            write(target, source)
    rows = [
        {
            "input": source.path,
            "descriptor": source.spec.name,
            "image_size": list(source.image_size),
            "shape": list(source.descriptor.shape),
            "output": str(target),
        }
        for target, source in zip(targets, sources, strict=True)
    ]
    if arguments.json:
        print(json.dumps(rows, indent=2))
    else:
        print_table(rows)
