"""The programs whose times are compared: every library on its own descriptor, and this package on the same.

    python benchmarks/programs.py PROGRAM BATCH SIDE [--vlfeat FILE] [--dlib FILE]

prints by how many MiB one call of a program raises the peak of the resident set.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import skimage.data
import skimage.transform
import torch
from torch import Tensor

from memory import raised_mib
from nablahog.hog import HOGSpec, hog, presets
from peers import NaiveHOG, can_compile, compiled, dlib, opencv, scikit_image, vlfeat
from timing import Call

SIDE_OF_FIRST = 32  # pixels of the image that loads what is loaded on first use
LIBRARIES = {"vlfeat": "VLFeat", "dlib": "dlib"}  # those that have to be given
PAPER, UOCTTI = presets.paper(), presets.uoctti(colour="gray")
Where: TypeAlias = Literal["all", "tables", "compiled"]
NAIVE, COMPILED, BACKWARD = "naive torch", "compiled torch", ", with backward"


class Photographs:
    """Gray photographs, the same as often as asked for.

    Attributes:
        levels: uint8 (B, side, side).
    """

    def __init__(self, batch: int, side: int) -> None:
        self.levels = np.repeat(cameraman(side)[None], batch, axis=0)

    @cached_property
    def floats(self) -> Tensor:
        """(B, 1, side, side) in 0…1, one copy for all programs."""
        return torch.from_numpy(self.levels).unsqueeze(1).float().div_(255)


def cameraman(side: int) -> Any:
    """uint8 (side, side): scikit-image's photograph of a cameraman, shrunk, or beyond its 512 pixels tiled."""
    image = skimage.data.camera()
    if side > len(image):  # enlarged it would be smoother than photographs are
        tile = np.block([[image, image[:, ::-1]], [image[::-1], image[::-1, ::-1]]])
        times = -(-side // len(tile))
        return np.tile(tile, (times, times))[:side, :side]
    small = skimage.transform.resize(image, (side, side), anti_aliasing=True, preserve_range=True)
    return small.round().astype(np.uint8)


@dataclass(frozen=True)
class Program:
    """Something that describes images.

    Attributes:
        name: unique.
        make: to a call that describes the photographs.
        beside: the programs whose times are divided by this one's.
        spec: of the dialect, if it is ours.
        backward: whether the derivative by the images is computed, too.
        where: it takes part: at all shapes, at those of the first tables, or at some of these, as it has to be compiled
            for each.
    """

    name: str
    make: Callable[[Photographs], Call]
    beside: tuple[str, ...] = ()
    spec: HOGSpec | None = None
    backward: bool = False
    where: Where = "all"


def forward(describe: Callable[[], Callable[[Tensor], Tensor]], photographs: Photographs) -> Call:
    x, program = photographs.floats, describe()
    return lambda: program(x)


def with_backward(describe: Callable[[], Callable[[Tensor], Tensor]], photographs: Photographs) -> Call:
    x, program = photographs.floats.detach().requires_grad_(), describe()
    given = torch.ones_like(program(x).detach())
    return lambda: torch.autograd.grad(program(x), x, given)


def _library(name: str, peer: Callable[[Any], Call]) -> Program:
    return Program(name, lambda photographs: peer(photographs.levels))


def _torch(name: str, describe: Callable[[], Callable[[Tensor], Tensor]], where: Where = "all") -> list[Program]:
    return [
        Program(name, functools.partial(forward, describe), where=where),
        Program(name + BACKWARD, functools.partial(with_backward, describe), backward=True, where=where),
    ]


def _ours(of: str, spec: HOGSpec, *beside: str, backward: bool = False, plain: bool = False) -> Program:
    describe = functools.partial(hog, spec=spec, backend="torch" if plain else "auto")
    name = f"ours, {of}" + (", plain steps" if plain else "") + (BACKWARD if backward else "")
    make = functools.partial(with_backward if backward else forward, lambda: describe)
    return Program(name, make, beside, spec, backward, "tables" if plain else "all")


def programs(libraries: Mapping[str, Path]) -> list[Program]:
    """All that can run here, of C libraries those that are given by the names of :data:`LIBRARIES`."""
    result = [_library("scikit-image", scikit_image), _library("OpenCV", opencv)]
    if "vlfeat" in libraries:
        result.append(_library("VLFeat", vlfeat(libraries["vlfeat"])))
    if "dlib" in libraries:
        result.append(_library("dlib", dlib(libraries["dlib"])))
    result += _torch(NAIVE, NaiveHOG)
    if can_compile():
        result += _torch(COMPILED, compiled, "compiled")
    result += [
        _ours("scikit-image's", presets.skimage(), "scikit-image"),
        _ours("OpenCV's", presets.opencv(gamma=False), "OpenCV"),
        _ours("VLFeat's", presets.vlfeat(bilinear_orientations=True), "VLFeat"),
        _ours("UoCTTI", UOCTTI, "VLFeat"),
        _ours("UoCTTI", UOCTTI, "VLFeat", backward=True),
        _ours("dlib's", presets.dlib(), "dlib"),
        _ours("the paper's", PAPER, NAIVE, plain=True),
        _ours("the paper's", PAPER, NAIVE, COMPILED, "OpenCV"),
        _ours("the paper's", PAPER, NAIVE + BACKWARD, COMPILED + BACKWARD, "OpenCV", backward=True),
    ]
    there = {program.name for program in result}
    return [replace(p, beside=tuple(name for name in p.beside if name in there)) for p in result]


def add_libraries(parser: argparse.ArgumentParser) -> None:
    for name in LIBRARIES:
        parser.add_argument(f"--{name}", type=Path, metavar="LIB", help="its shared library, see benchmarks/README.md")


def given_libraries(options: argparse.Namespace) -> dict[str, Path]:
    return {name: getattr(options, name) for name in LIBRARIES if getattr(options, name) is not None}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("program")
    parser.add_argument("batch", type=int)
    parser.add_argument("side", type=int)
    add_libraries(parser)
    options = parser.parse_args()
    torch.set_num_threads(1)
    program = next(p for p in programs(given_libraries(options)) if p.name == options.program)
    program.make(Photographs(1, SIDE_OF_FIRST))()
    photographs = Photographs(options.batch, options.side)
    _ = photographs.floats
    print(raised_mib(program.make(photographs)))


if __name__ == "__main__":
    main()
