"""Eq. 7 and the block schemes: from cell histograms to the descriptor."""

from __future__ import annotations

import torch
from torch import Tensor

from .spec import HOGSpec


def normalize_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The spec's normaliser: cell histograms (B, colours · bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    each = histograms.reshape(-1, spec.bins, *histograms.shape[2:])
    with torch.autocast(histograms.device.type, enabled=False):  # as in :func:`.steps.histograms_reference`
        descriptor = spec.normalizer.normalize(each, spec.signed)
    return descriptor.reshape(-1, spec.channels, *descriptor.shape[2:])
