"""An image with padding, as the native loops read it."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from .arguments import Size

_SIZES = "height", "width", "channels", "top", "left", "padded_height", "padded_width"


class Padded(ctypes.Structure):
    """``PaddedImage`` of ``native/opencv_votes.h``: an image padded by reflection at its outermost pixels.

    Attributes:
        image: (rows, cols, channels).
        before: (x, y) pixels of padding on the left and at the top.
        after: the same on the right and at the bottom.
        size: (width, height) with the padding.
    """

    _fields_ = [("pixels", ctypes.c_void_p), *((name, ctypes.c_int64) for name in _SIZES)]

    def __init__(self, image: NDArray[np.uint8], before: Size, after: Size) -> None:
        height, width, channels = image.shape
        self.image, self.before, self.after = image, before, after
        self.size = width + before[0] + after[0], height + before[1] + after[1]
        super().__init__(image.ctypes.data, height, width, channels, *before[::-1], *self.size[::-1])

    def inside(self, corners: NDArray[np.int64], window: Size) -> NDArray[np.bool_]:
        """Which windows lie in the padded image."""
        inside: NDArray[np.bool_] = np.all((corners >= 0) & (corners <= np.subtract(self.size, window)), axis=1)
        return inside
