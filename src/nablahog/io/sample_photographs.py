"""Sample photographs: those that scikit-image installs; nothing is downloaded."""

from __future__ import annotations

import torch
from torch import Tensor

SAMPLE_NAMES = ("astronaut", "brick", "camera", "chelsea", "clock", "coffee", "coins", "rocket")
"""Names of the photographs in the wheel of scikit-image."""


def sample_photograph(name: str) -> Tensor:
    """One of :data:`SAMPLE_NAMES`, (C, H, W) with C 1 or 3, float32 in 0…1."""
    from skimage import data  # slow to import

    photograph = torch.from_numpy(getattr(data, name)())
    return (photograph.permute(2, 0, 1) if photograph.dim() == 3 else photograph[None]) / 255
