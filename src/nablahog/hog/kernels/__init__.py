"""The operator's steps fused into compiled loops for CPUs, for searches that evaluate it thousands of times.

They return what the plain steps return, up to rounding, with their first derivatives in reverse mode only: a minimiser
asks for no more.  ``tests/hog/test_kernels.py`` holds both side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import torch
from torch import Tensor

from ..descriptor import histograms
from ..normalize import normalize
from ..spec import HOGSpec
from . import blocks, cells

Step: TypeAlias = Callable[[Tensor, HOGSpec], Tensor]


def steps(device: torch.device, spec: HOGSpec) -> tuple[Step, Step]:
    """The fastest ``histograms`` of gray images (B, 1, H, W) and ``normalize`` of the dialect on that device."""
    on_cpu = device.type == "cpu"
    return (
        cells.histograms if on_cpu and cells.supports(spec) else histograms,
        blocks.normalize if on_cpu and blocks.supports(spec) else normalize,
    )
