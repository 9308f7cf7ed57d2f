"""Images of one size, in an array, a tensor or a list, as one array."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from .arrays import WHITE, advise_on_axes, as_array
from .pil_images import is_pil, pil_pixels


def as_batch(name: str, images: object) -> NDArray[Any]:
    """Images (B, H, W, C) of one size, finite, of an array or a list: uint8, float32, or float64 for other floats.

    Args:
        name: of the argument.
        images: an array (B, H, W) or (B, H, W, C), a tensor (B, H, W), (B, H, W, C) or (B, C, H, W), C 1 or 3, or what
            NumPy makes an array of; or a list of such images without B and of PIL images.  Of a list of bytes and
            floats, bytes are divided by 255.

    Raises:
        TypeError: an image is none of them, or of integers other than uint8.
        ValueError: there are none, an image has other axes, masks some pixels or is not finite, or sizes or channels
            differ.
    """
    if is_pil(images):
        raise TypeError(f"{name} must be a batch of images, got a PIL image: write [image]")
    is_list = isinstance(images, list | tuple)
    if not is_list and not (isinstance(images, np.ndarray) and images.dtype == object and images.ndim == 1):
        return _read_batch(name, images)
    parts = [_read_batch(f"{name}[{k}]", image, is_single=True) for k, image in enumerate(images)]  # type: ignore[arg-type, var-annotated]
    if not parts:
        raise ValueError(f"{name} must hold images, got none")
    shapes = sorted({part.shape[1:] for part in parts})
    if len(shapes) > 1:
        raise ValueError(
            f"{name} must hold images of one size and of as many channels, got {shapes[0]} and {shapes[-1]}: write "
            "image.convert('RGB').resize((width, height)) of each as a PIL image"
        )
    if len({part.dtype for part in parts}) > 1:
        parts = [part / np.float32(255) if part.dtype == np.uint8 else part for part in parts]
    return np.concatenate(parts)


def _read_batch(name: str, images: object, is_single: bool = False) -> NDArray[Any]:
    """Images (B, H, W, C), or one without B."""
    array = pil_pixels(name, images) if is_pil(images) else as_array(name, images)  # type: ignore[arg-type]
    shape = array.shape
    array = array[np.newaxis] if is_single else array
    if isinstance(images, Tensor) and array.ndim == 4 and array.shape[1] in (1, 3):
        array = np.moveaxis(array, 1, -1)
    array = array[..., np.newaxis] if array.ndim == 3 else array
    if array.ndim != 4 or array.shape[-1] not in (1, 3):
        axes = "(H, W) or (H, W, C)" if is_single else "(B, H, W) or (B, H, W, C)"
        raise ValueError(f"{name} must be {axes} with C 1 or 3, got {shape}: {_advise_on_batch(shape, is_single)}")
    if array.dtype.kind in "iu" and array.dtype != np.uint8:
        raise TypeError(f"{name} must be floats in 0…1, or uint8 in 0…255, got {array.dtype}{WHITE}")
    if not array.size:
        raise ValueError(f"{name} must hold pixels, got none, of shape {shape}")
    if array.dtype not in (np.uint8, np.float32, np.float64):
        array = array.astype(np.float64)
    if array.dtype != np.uint8 and not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got NaN or infinity: write np.nan_to_num(images)")
    return array


def _advise_on_batch(shape: tuple[int, ...], is_single: bool) -> str:
    if is_single and len(shape) == 4:
        return "write image[0] for each of them, or one array of all images"
    if len(shape) != (3 if is_single else 4):
        return f"write array.reshape({'' if is_single else '-1, '}height, width)"
    if shape[-3] in (1, 3) or shape[-1] == 4:
        return advise_on_axes(shape)
    return "write array[..., 0] for its first channel"
