"""The operator ∇HOG: the four steps of Section 2 in a row."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn

from .gradient import gradient
from .layout import to_layout
from .normalize import normalize
from .orientation import votes
from .pooling import pool
from .spec import COLOURS, HOGSpec


def _scaled(images: Tensor, spec: HOGSpec) -> Tensor:
    """Checked images in 0…``spec.value_range``, floating point."""
    if not isinstance(images, Tensor):
        raise TypeError(f"images must be a torch tensor (B, C, H, W), got {type(images).__name__}")
    if images.dim() != 4 or images.shape[1] < 1:
        raise ValueError(f"images must have shape (B, C, H, W) with at least one channel, got {tuple(images.shape)}")
    if spec.colour == "separate" and images.shape[1] not in (1, COLOURS):
        raise ValueError(f"a {spec.name} descriptor is of images of 1 or {COLOURS} channels, got {images.shape[1]}")
    spec.grid(*images.shape[-2:])
    if images.dtype == torch.uint8:
        return images.to(torch.get_default_dtype()) * (spec.value_range / 255)
    if images.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"images must be float32 or float64 in 0…1, or uint8 in 0…255, got {images.dtype}")
    return images if spec.value_range == 1 else images * spec.value_range


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """Cell histograms before normalisation, Eq. 1-6: images as for :func:`hog` to (B, colours · bins, rows, cols).

    Entries are votes, gradient magnitudes in units of the spec's ``value_range``, 0 or more.
    """
    images = _scaled(images, spec)
    with torch.autocast(images.device.type, enabled=False):  # its half precision would show in every library's parity
        gx, gy = gradient(images, spec)  # Eq. 1-2
        cells = pool(votes(gx, gy, spec), spec)  # Eq. 3-6
        return cells.reshape(-1, spec.colours * spec.bins, *cells.shape[2:])


def hog(images: Tensor, spec: HOGSpec, *, layout: Literal["cells", "native"] = "cells") -> Tensor:
    """The HOG descriptor of a batch of images, exactly differentiable (Section 2 of the paper).

    Works on CPU and CUDA, under reverse and forward mode, ``vmap`` and ``torch.compile``; second derivatives exist away
    from kinks.  At kinks it returns the derivatives stated in ``docs/derivatives.md``, never NaN.  A NaN pixel makes
    its image's descriptor NaN.

    Args:
        images: (B, C, H, W), float32 or float64 in 0…1, or uint8 in 0…255; any number of channels (three are R, G, B).
        spec: the dialect, from :mod:`nablahog.presets`.
        layout: ``"cells"``, or ``"native"``, the shape and order that the library itself returns.

    Returns:
        (B, rows, cols, channels), or B in front of the library's own shape; the dtype of the images (the default dtype
        for uint8).

    Raises:
        TypeError: ``images`` is no tensor, or of another dtype.
        ValueError: ``images`` is not four-dimensional, or smaller than one cell.
    """
    found = normalize(histograms(images, spec), spec).permute(0, 2, 3, 1).contiguous()  # Eq. 7
    return found if layout == "cells" else to_layout(found, spec)


class HOG(nn.Module):
    """:func:`hog` with its spec, as a module to put into a network.  It has no parameters."""

    def __init__(self, spec: HOGSpec) -> None:
        super().__init__()
        self.spec = spec

    def forward(self, images: Tensor) -> Tensor:
        """Images (B, C, H, W) to descriptors (B, rows, cols, channels); see :func:`hog`."""
        return hog(images, self.spec)

    def extra_repr(self) -> str:
        return self.spec.name + f", cell_size={self.spec.cell_size}"
