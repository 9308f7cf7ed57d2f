"""What the operator is measured against: other programs' HOG, and a torch layer as one would write it.

Each library's makes of gray images, uint8 (B, H, W), a call that describes them one after the other.
"""

from __future__ import annotations

import ctypes
import math
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import skimage.feature
import torch
import torch.nn.functional as F
from torch import Tensor

from timing import Call

Peer: TypeAlias = Callable[[Any], Call]


def scikit_image(images: Any) -> Call:
    return lambda: [skimage.feature.hog(image) for image in images]


def opencv(images: Any) -> Call:
    """One window as large as the image, without gamma correction."""
    cv2.setNumThreads(1)
    height, width = images.shape[1:]
    window = cv2.HOGDescriptor((width // 8 * 8, height // 8 * 8), (16, 16), (8, 8), (8, 8), 9)
    return lambda: [window.compute(image) for image in images]


def vlfeat(library: Path) -> Peer:
    """``vl_hog`` with bilinear orientations, by its C API; of VLFeat built as a shared library."""
    vl = ctypes.CDLL(str(library))
    for name in ("vl_hog_get_width", "vl_hog_get_height", "vl_hog_get_dimension"):
        getattr(vl, name).restype = ctypes.c_size_t
    vl.vl_hog_new.restype = ctypes.c_void_p

    def peer(images: Any) -> Call:
        floats = np.ascontiguousarray(images, np.float32)
        hog = ctypes.c_void_p(vl.vl_hog_new(1, ctypes.c_size_t(9), 0))
        vl.vl_hog_set_use_bilinear_orientation_assignments(hog, 1)
        height, width = floats.shape[1:]

        def describe(image: Any) -> Any:
            sizes = (ctypes.c_size_t(n) for n in (width, height, 1, 8))
            vl.vl_hog_put_image(hog, image.ctypes.data_as(ctypes.c_void_p), *sizes)
            shape = [int(getattr(vl, f"vl_hog_get_{n}")(hog)) for n in ("dimension", "height", "width")]
            result = np.empty(shape, np.float32)
            vl.vl_hog_extract(hog, result.ctypes.data_as(ctypes.c_void_p))
            return result

        return lambda: [describe(image) for image in floats]

    return peer


def dlib(library: Path) -> Peer:
    """``extract_fhog_features``, by ``dlib_fhog.cpp``."""
    fhog = ctypes.CDLL(str(library)).fhog
    fhog.restype = ctypes.c_long

    def peer(images: Any) -> Call:
        rows, cols = images.shape[1:]
        result = np.empty(31 * (rows // 8 + 1) * (cols // 8 + 1), np.float32)

        def describe(image: Any) -> int:
            sizes = ctypes.c_long(rows), ctypes.c_long(cols), ctypes.c_int(8)
            to = result.ctypes.data_as(ctypes.c_void_p)
            return int(fhog(image.ctypes.data_as(ctypes.c_void_p), *sizes, to))

        return lambda: [describe(image) for image in images]

    return peer


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


def compiled() -> Callable[[Tensor], Tensor]:
    """``torch.compile`` of the naive layer, for one shape: compiles in the first call, and in the first derivative."""
    torch.compiler.reset()  # of one function, a process compiles few versions, and takes it as it is from then on
    layer: Callable[[Tensor], Tensor] = torch.compile(NaiveHOG(), dynamic=False)
    return layer


def can_compile() -> bool:
    """Whether there is the C++ compiler that ``torch.compile`` needs."""
    return any(shutil.which(name) for name in (os.environ.get("CXX", "g++"), "clang++", "c++"))
