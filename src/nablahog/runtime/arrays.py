"""Types of the arrays and numbers that compiled loops take."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.floating[Any]]
"""Of float32 or float64; all floating-point arguments of one call have the same."""
Integers: TypeAlias = NDArray[np.integer[Any]]
Flags: TypeAlias = NDArray[np.bool_]
Stored: TypeAlias = NDArray[Any]
"""Pixels as they are stored: uint8, float32 or float64."""
Real: TypeAlias = "np.floating[Any]"
"""One number of such arrays."""
DType: TypeAlias = "np.dtype[np.floating[Any]]"
