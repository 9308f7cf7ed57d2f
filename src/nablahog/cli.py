"""The command ``nablahog``: reads and checks all inputs, does the work, writes the results."""

from __future__ import annotations

import io
import json
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path

from PIL import Image

from .arguments import parser
from .demo import DESCRIPTORS, run_demo
from .descriptor_file import save_descriptor
from .dialects_command import dialects
from .draw import glyphs
from .exemplars_command import learn_exemplars
from .images import write_image
from .inversion import Inversion, batches, invert_batch, result_names
from .learn_command import learn_background, learn_bovw, learn_hoggles, learn_nearest, learn_prior, learn_ridge
from .metrics import DEFINITIONS
from .output import output_folder, replacing
from .pose_command import pose
from .preset_option import Wanted
from .prior_option import prior_for
from .raw_option import Raw
from .refusal import UserError, refusing, spare
from .sources import Source, read_sources
from .table1_command import table1
from .table2_command import table2
from .template_command import invert_template
from .terminal import print_definitions, print_table, progress_bars, say

INTERRUPTED = 130  # what shells report of a command ended by Ctrl-C


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command with ``argv``, by default the arguments of this process.

    Returns:
        The exit status: 0; 1 after an error, which one line on stderr has told; 2 for wrong arguments; 130 when
        interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # file names and units need not fit the terminal's encoding
    try:
        arguments = parser().parse_args(argv)
    except SystemExit as stop:  # --help, --version or wrong arguments: all said
        return int(stop.code or 0)
    name = f"nablahog {arguments.command}"
    try:
        _COMMANDS[arguments.command](arguments)
        sys.stdout.flush()  # a closed pipe should fail here, not at exit
    except KeyboardInterrupt:
        return _failed(name, "interrupted", INTERRUPTED)
    except BrokenPipeError:
        # whoever read our output has enough; Python would complain when it flushes stdout at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (UserError, OSError) as error:
        return _failed(name, str(error))
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        return _failed(name, "not enough memory; a smaller --size, or fewer inputs at once, need less")
    return 0


def _failed(name: str, message: str, status: int = 1) -> int:
    print(f"{name}: error: {' '.join(message.split())}", file=sys.stderr)
    return status


def _hog(arguments: Namespace) -> None:
    def write(path: Path, source: Source) -> None:
        save_descriptor(path, source.descriptor, source.spec, source.image_size)

    is_file = not arguments.output.endswith(os.sep)  # a file of any name, since np.load does not mind
    _write_each(arguments, ".npz", write, is_file=is_file)


def _glyph(arguments: Namespace) -> None:
    def write(path: Path, source: Source) -> None:
        write_image(path, glyphs(source.descriptor, source.spec))

    suffix = Path(arguments.output).suffix.lower()
    if suffix != ".png" and suffix in Image.registered_extensions():
        raise UserError(f"glyphs are written as PNG: expected -o FILE.png or a folder, got {arguments.output}")
    _write_each(arguments, "_glyphs.png", write, is_file=suffix == ".png")


def _invert(arguments: Namespace) -> None:
    sources = _read(arguments)
    if arguments.colour and arguments.prior:
        raise UserError("--colour and --prior exclude each other: what is learned are gray images")
    prior = prior_for(arguments, [(source.path, source.spec) for source in sources])
    folder = Path(arguments.output)
    spare(arguments.inputs, [folder / name for source in sources for name in result_names(source)])
    done: dict[int, Inversion] = {}
    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            with progress_bars() as progress, refusing(f"{', '.join(sources[i].path for i in batch)}: "):
                found = invert_batch(
                    [sources[i] for i in batch],
                    device=arguments.device,
                    quality=arguments.quality,
                    seed=arguments.seed,
                    max_evaluations=arguments.max_evaluations,
                    prior=prior,
                    colour=arguments.colour,
                    progress=progress(about),
                )
            done.update(zip(batch, found, strict=True))
            for index in batch:
                done[index].write(folder)
            # after each batch, so that an interrupted run leaves its finished part whole
            figures = [done[index].figures() for index in sorted(done)]
            with replacing(folder / "results.json") as file:
                file.write((json.dumps(figures, indent=2, allow_nan=False) + "\n").encode())
    if arguments.json:
        print(json.dumps(figures, indent=2, allow_nan=False))
    else:
        _print_figures([done[index] for index in sorted(done)])
        say(f"Results in {folder}")


def _demo(arguments: Namespace) -> None:
    with output_folder(arguments.output) as folder, progress_bars() as progress:
        tasks = {name: progress(name) for name in DESCRIPTORS}
        inversions = run_demo(
            folder,
            device=arguments.device,
            seed=arguments.seed,
            progress=lambda name, done, total: tasks[name](done, total),
            max_evaluations=arguments.max_evaluations,
        )
    _print_figures(inversions)
    say(f"Look at {folder / 'index.html'}")


_COMMANDS: dict[str, Callable[[Namespace], None]] = {
    "hog": _hog,
    "glyph": _glyph,
    "invert": _invert,
    "invert-template": invert_template,
    "demo": _demo,
    "table1": table1,
    "table2": table2,
    "pose": pose,
    "dialects": dialects,
    "learn prior": learn_prior,
    "learn background": learn_background,
    "learn hoggles": learn_hoggles,
    "learn bovw": learn_bovw,
    "learn ridge": learn_ridge,
    "learn nearest": learn_nearest,
    "learn exemplars": learn_exemplars,
}


def _read(arguments: Namespace) -> list[Source]:
    with refusing():
        return read_sources(
            arguments.inputs,
            Wanted.of(arguments),
            size=arguments.size,
            device=arguments.device,
            keep_photos=arguments.command == "invert",
            raw=None if arguments.command == "hog" else Raw.of(arguments),
        )


def _write_each(arguments: Namespace, ending: str, write: Callable[[Path, Source], None], *, is_file: bool) -> None:
    """One result for each input: the file ``-o`` for a single one, if ``is_file``; else files in the folder ``-o``."""
    sources = _read(arguments)
    output = Path(arguments.output)
    if len(sources) > 1 and output.suffix and ending.endswith(output.suffix.lower()):
        raise UserError(f"several inputs need a folder: expected -o DIR, got the file name {output}")
    if len(sources) == 1 and is_file and not output.is_dir():
        folder, targets = output.parent, [output]
    else:
        folder, targets = output, [output / f"{source.stem}{ending}" for source in sources]
    spare(arguments.inputs, targets)
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


def _print_figures(inversions: Sequence[Inversion]) -> None:
    print_table([inversion.row() for inversion in inversions])
    print_definitions(DEFINITIONS)
