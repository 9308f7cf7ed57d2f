"""Triton's interpreter runs the kernels on a CPU, see ``tests/conftest.py``; where there is a GPU, it does."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest
import torch

if find_spec("triton") is None:
    collect_ignore_glob = ["test_*.py"]

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


@pytest.fixture(autouse=True)
def _no_warnings_of_numpy() -> Iterator[None]:
    """The interpreter computes with NumPy, which warns of infinity and of lanes that are masked later."""
    with np.errstate(all="ignore"):
        yield
