"""Images for the benchmarks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from skimage import data
from torch import Tensor
from torch.nn.functional import interpolate

from nablahog.hog.gradient import gray
from nablahog.io.images import read_image

SIDE = 128
SAMPLE_NAMES = ("camera", "astronaut", "coffee", "coins", "chelsea", "clock", "rocket", "brick")


def photographs(folder: Path | None) -> Tensor:
    """(N, 1, H, W) in 0…1: the images of a folder, all of one size, or :func:`sample_photographs` without one."""
    if folder is None:
        return sample_photographs()
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in {".png", ".jpg", ".jpeg"})
    return torch.stack([gray(read_image(file)[None])[0] for file in files])


def sample_photographs() -> Tensor:
    """(8, 1, 128, 128): photographs that scikit-image installs, cropped to a square, 8-bit levels."""
    images = []
    for name in SAMPLE_NAMES:
        picture = torch.from_numpy(np.atleast_3d(getattr(data, name)())).float()
        side = min(picture.shape[:2])
        square = gray(picture[:side, :side].permute(2, 0, 1)[None])
        images.append(interpolate(square, size=(SIDE, SIDE), mode="area").round() / 255)
    return torch.cat(images)
