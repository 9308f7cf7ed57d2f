"""Types of the arrays and numbers that compiled loops take."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.floating[Any]]
"""Of float32 or float64; all floating-point arguments of one call have the same."""
Integers: TypeAlias = NDArray[np.integer[Any]]
Flags: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Real: TypeAlias = "np.floating[Any]"
"""One number of such arrays."""
DType: TypeAlias = "np.dtype[np.floating[Any]]"
