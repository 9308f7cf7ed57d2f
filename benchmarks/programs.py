"""The programs whose times are compared: every library on its own descriptor, and this package on the same.

    python benchmarks/programs.py PROGRAM BATCH SIDE [--vlfeat SOURCES] [--dlib SOURCES]

prints by how many MiB one call of a program raises the peak of the resident set.
"""

from __future__ import annotations

import argparse
import ctypes
import functools
import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
import skimage.data
import skimage.feature
import skimage.transform
import torch
import torch.nn.functional as F
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets
from timing import Call, raised_mib

Describe: TypeAlias = Callable[[Tensor], Tensor]
Where: TypeAlias = Literal["all", "main", "compiled"]
PAPER, UOCTTI = presets.paper(), presets.uoctti(colour="gray")
NAIVE, COMPILED, BACKWARD = "naive torch", "compiled torch", ", with backward"
VLFEAT = ("hog.c", "mathop.c", "generic.c", "host.c", "random.c")
VLFEAT_OPTIONS = ("-DVL_DISABLE_SSE2", "-DVL_DISABLE_AVX", "-lm", "-lpthread")
DLIB = """
#include <dlib/image_transforms/fhog.h>
#include <cstring>
extern "C" void fhog(const unsigned char* pixels, long rows, long cols, float* out) {
  dlib::array2d<unsigned char> image(rows, cols);
  for (long r = 0; r < rows; ++r) std::memcpy(&image[r][0], pixels + r * cols, cols);
  dlib::array<dlib::array2d<float>> planes;
  dlib::extract_fhog_features(image, planes, 8);
  for (unsigned long k = 0; k < planes.size(); ++k)
    for (long r = 0; r < planes[k].nr(); ++r)
      for (long c = 0; c < planes[k].nc(); ++c) *out++ = planes[k][r][c];
}
"""


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
        where: it takes part: at all shapes, at the main ones, or at some of these, as it is compiled for each shape.
    """

    name: str
    make: Callable[[Photographs], Call]
    beside: tuple[str, ...] = ()
    spec: HOGSpec | None = None
    where: Where = "all"

    @property
    def backward(self) -> bool:
        """Whether the derivative with respect to the images is computed, too."""
        return self.name.endswith(BACKWARD)


def scikit_image(photographs: Photographs) -> Call:
    return lambda: [skimage.feature.hog(image) for image in photographs.levels]


def opencv(photographs: Photographs) -> Call:
    """One window as large as the image, without gamma correction."""
    cv2.setNumThreads(1)
    height, width = photographs.levels.shape[1:]
    window = cv2.HOGDescriptor((width // 8 * 8, height // 8 * 8), (16, 16), (8, 8), (8, 8), 9)
    return lambda: [window.compute(image) for image in photographs.levels]


def built(compiler: str, source: str, *options: str) -> ctypes.CDLL:
    """A shared library of the source text, which may be empty, and of the files among the options."""
    with tempfile.TemporaryDirectory() as folder:
        library, file = Path(folder, "library.so"), Path(folder, "source.cpp")
        file.write_text(source)
        files = [str(file)] if source else []
        command = [compiler, "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library), *files, *options]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(library))


def vlfeat(sources: Path) -> Callable[[Photographs], Call]:
    """``vl_hog`` with bilinear orientations, by its C API, built from VLFeat's sources."""
    files = (str(sources / "vl" / name) for name in VLFEAT)
    vl = built("gcc", "", "-I", str(sources), *files, *VLFEAT_OPTIONS)
    for name in ("vl_hog_get_width", "vl_hog_get_height", "vl_hog_get_dimension"):
        getattr(vl, name).restype = ctypes.c_size_t
    vl.vl_hog_new.restype = ctypes.c_void_p

    def make(photographs: Photographs) -> Call:
        floats = np.ascontiguousarray(photographs.levels, np.float32)
        descriptor = ctypes.c_void_p(vl.vl_hog_new(1, ctypes.c_size_t(9), 0))
        vl.vl_hog_set_use_bilinear_orientation_assignments(descriptor, 1)
        height, width = floats.shape[1:]

        def describe(image: Any) -> Any:
            sizes = (ctypes.c_size_t(n) for n in (width, height, 1, 8))
            vl.vl_hog_put_image(descriptor, image.ctypes.data_as(ctypes.c_void_p), *sizes)
            shape = [int(getattr(vl, f"vl_hog_get_{n}")(descriptor)) for n in ("dimension", "height", "width")]
            result = np.empty(shape, np.float32)
            vl.vl_hog_extract(descriptor, result.ctypes.data_as(ctypes.c_void_p))
            return result

        return lambda: [describe(image) for image in floats]

    return make


def dlib(sources: Path) -> Callable[[Photographs], Call]:
    """``extract_fhog_features``, built from dlib's sources."""
    fhog = built("g++", DLIB, "-I", str(sources)).fhog
    fhog.restype = None

    def make(photographs: Photographs) -> Call:
        rows, cols = photographs.levels.shape[1:]
        result = np.empty(31 * (rows // 8 + 1) * (cols // 8 + 1), np.float32)

        def describe(image: Any) -> Any:
            to = result.ctypes.data_as(ctypes.c_void_p)
            fhog(image.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(rows), ctypes.c_long(cols), to)
            return result

        return lambda: [describe(image) for image in photographs.levels]

    return make


class NaiveHOG(torch.nn.Module):
    """The paper's descriptor as one would write it with PyTorch: votes into all bins, and a convolution."""

    triangle: Tensor

    def __init__(self) -> None:
        super().__init__()
        ramp = 1 - (torch.arange(16) - 7.5).abs() / 8
        self.register_buffer("triangle", torch.outer(ramp, ramp).expand(9, 1, 16, 16).clone())

    def forward(self, images: Tensor) -> Tensor:
        """(B, 1, H, W) in 0…1 to (B, H/8, W/8, 9)."""
        padded = F.pad(images, (1, 1, 1, 1), mode="reflect")
        gx = padded[:, :, 1:-1, 2:] - padded[:, :, 1:-1, :-2]
        gy = padded[:, :, 2:, 1:-1] - padded[:, :, :-2, 1:-1]
        magnitude = torch.sqrt(gx * gx + gy * gy + 1e-12)
        position = torch.remainder(torch.atan2(gy, gx + 1e-12) / math.pi, 1) * 9 - 0.5
        away = (position - torch.arange(9.0).view(1, 9, 1, 1)).abs()
        votes = magnitude * (1 - torch.minimum(away, 9 - away)).clamp(min=0)
        cells = F.conv2d(votes, self.triangle, stride=8, padding=4, groups=9)
        energy = cells.square().sum(dim=(1, 2, 3), keepdim=True)
        return (cells / torch.sqrt(torch.sqrt(energy) + 1e-5)).permute(0, 2, 3, 1)


def compiled() -> Describe:
    """``torch.compile`` of the naive layer, for one shape."""
    torch.compiler.reset()  # a process compiles few versions of a function, and then runs it as it is
    layer: Describe = torch.compile(NaiveHOG(), dynamic=False)
    return layer


def forward(describe: Callable[[], Describe], photographs: Photographs) -> Call:
    x, program = photographs.floats, describe()
    return lambda: program(x)


def with_backward(describe: Callable[[], Describe], photographs: Photographs) -> Call:
    x, program = photographs.floats.detach().requires_grad_(), describe()
    ones = torch.ones_like(program(x).detach())
    return lambda: torch.autograd.grad(program(x), x, ones)


def _torch(name: str, describe: Callable[[], Describe], where: Where = "all") -> list[Program]:
    return [
        Program(name, functools.partial(forward, describe), where=where),
        Program(name + BACKWARD, functools.partial(with_backward, describe), where=where),
    ]


def _ours(of: str, spec: HOGSpec, *beside: str, backward: bool = False, plain: bool = False) -> Program:
    describe = functools.partial(hog, spec=spec, backend="torch" if plain else "auto")
    name = f"ours, {of}" + (", plain steps" if plain else "") + (BACKWARD if backward else "")
    make = functools.partial(with_backward if backward else forward, lambda: describe)
    return Program(name, make, beside, spec, "main" if plain else "all")


def programs(options: argparse.Namespace) -> list[Program]:
    """All that can run here; VLFeat and dlib where their sources are given."""
    result = [Program("scikit-image", scikit_image), Program("OpenCV", opencv)]
    if options.vlfeat:
        result.append(Program("VLFeat", vlfeat(options.vlfeat)))
    if options.dlib:
        result.append(Program("dlib", dlib(options.dlib)))
    result += _torch(NAIVE, NaiveHOG)
    if any(shutil.which(name) for name in (os.environ.get("CXX", "g++"), "clang++", "c++")):
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
    names = {program.name for program in result}
    return [replace(each, beside=tuple(name for name in each.beside if name in names)) for each in result]


def add_libraries(parser: argparse.ArgumentParser) -> None:
    for name in ("vlfeat", "dlib"):
        parser.add_argument(f"--{name}", type=Path, metavar="SOURCES", help="its source folder, to measure it, too")


def library_options(options: argparse.Namespace) -> list[str]:
    """The options of :func:`add_libraries` as they were given."""
    return [f"--{name}={getattr(options, name)}" for name in ("vlfeat", "dlib") if getattr(options, name)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("batch", type=int)
    parser.add_argument("side", type=int)
    add_libraries(parser)
    options = parser.parse_args()
    torch.set_num_threads(1)
    program = next(each for each in programs(options) if each.name == options.program)
    program.make(Photographs(1, 32))()
    photographs = Photographs(options.batch, options.side)
    _ = photographs.floats
    print(raised_mib(program.make(photographs)))


if __name__ == "__main__":
    main()
