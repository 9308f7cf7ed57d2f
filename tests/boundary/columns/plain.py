"""The plain inputs: tiny, float32 in 0…1, and of whole levels of 8 bits, so that files hold the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from nablahog import Camera, Mesh, hog, render

from ..table import Use

HEIGHT, WIDTH = 48, 40
MESH = Mesh(
    [[-0.5, 0, -0.5], [0.5, 0, -0.5], [0, 0.3, 0.5], [0, -0.4, 0.2]],
    [[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]],
    [0.2, 0.4, 0.8, 0.6],
).normalized()
CAMERA = Camera(64.0, HEIGHT, WIDTH)
POSES = torch.tensor([[30.0, 20, 2, 0, 0, 0], [50.0, 10, 2, 0, 0, 0]])
BOX = (6, 8, 34, 40)


def _image(texture: int) -> Any:
    """(H, W), no two quarters or turns of which are alike."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    waves = 0.15 * np.sin(x / 3 + texture) * np.cos(y / 5) + 0.1 * x / WIDTH - 0.05 * y / HEIGHT
    object_ = render(MESH, POSES[:1], CAMERA)[0, 0].numpy()
    return (np.rint(255 * (0.7 * object_ + waves + 0.15).clip(0, 1)) / 255).astype(np.float32)


IMAGE, OTHER = _image(0), _image(1)
BATCH = torch.from_numpy(np.stack([IMAGE, OTHER]))[:, None]
SMALL = BATCH[:, :, 12:36, 8:24].contiguous()  # 24x16 pixels
MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[BOX[1] : BOX[3], BOX[0] : BOX[2]] = True
DESCRIPTOR, UNSIGNED = hog(SMALL, "uoctti"), hog(SMALL, "paper")
SIZE = (24, 16)


def as_batch(x: Any) -> Tensor:
    """An image (H, W) or (H, W, 3) as (1, C, H, W)."""
    x = torch.from_numpy(np.ascontiguousarray(x, dtype=np.float32))
    return (x[None] if x.dim() == 2 else x.permute(2, 0, 1))[None]


def as_bytes(x: Any) -> Any:
    return np.rint(np.asarray(x) * 255).astype(np.uint8)


def image(call: Any, plain: Any = lambda x: x) -> Use:
    return Use(call, IMAGE, plain)


def batch(call: Any, plain: Any = lambda x: x) -> Use:
    return Use(call, BATCH, plain)


def name(call: Any) -> Use:
    return Use(call, "uoctti")


def size(call: Any, base: tuple[int, int] = SIZE) -> Use:
    return Use(call, base)


number = Use
angle = Use  # any real number: angles, weights, shares
