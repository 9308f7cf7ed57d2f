"""An object whose pixels are known: what is around it does not count."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..hog.box import Box


def masked(photograph: Tensor, mask: Tensor, box: Sequence[float] | None = None) -> tuple[Tensor, Box]:
    """The photograph with nothing around the object, and the object's box.

    Pixels around the object get the photograph's mean, so that no edge is left there but the object's own outline.

    Args:
        photograph: (C, H, W), floating point.
        mask: (H, W), bool, true where the object is.
        box: the object's; by default that of the mask.

    Raises:
        ValueError: the mask has another shape or type, or is nowhere true.
    """
    if mask.dtype != torch.bool or mask.shape != photograph.shape[1:]:
        raise ValueError(
            f"the mask must be bool of the photograph's shape {tuple(photograph.shape[1:])}, "
            f"got {str(mask.dtype).removeprefix('torch.')} of shape {tuple(mask.shape)}"
        )
    if not bool(mask.any()):
        raise ValueError("the mask must be true where the object is, but it is nowhere")
    if box is None:
        rows, cols = mask.any(1).nonzero(), mask.any(0).nonzero()
        box = Box(float(cols.min()), float(rows.min()), float(cols.max()) + 1, float(rows.max()) + 1)
    return torch.where(mask, photograph, photograph.mean()), Box.of(box)
