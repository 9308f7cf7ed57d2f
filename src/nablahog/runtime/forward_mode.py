"""PyTorch's forward mode, without what its first use in a process says of PyTorch itself."""

from __future__ import annotations

import warnings
from functools import cache

import torch
from torch.autograd import forward_ad


@cache
def load_forward_mode() -> None:
    """Loads what forward mode needs: PyTorch calls a function for it that it has deprecated, and warns of that."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with forward_ad.dual_level():
            forward_ad.make_dual(torch.zeros(1), torch.ones(1))  # type: ignore[no-untyped-call]
