"""NumPy arrays and PIL images where tensors are expected: one rule for their axes (``docs/conventions.md``).

Tensors have the axes of PyTorch, images (B, C, H, W).  Arrays have those of the libraries they come from, channels
last: (H, W), (H, W, C) or (B, H, W, C), where C is 1 or 3.  Descriptors are (B, rows, cols, channels) in both.  An
array without the axis B gives a result without it.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

if TYPE_CHECKING:
    from PIL.Image import Image

ArrayImage: TypeAlias = "NDArray[Any] | Image"
"""An image, or a batch of them, that is no tensor."""
Descriptors = TypeVar("Descriptors", Tensor, NDArray[Any])
"""Descriptors as tensors or arrays: a function that takes one kind returns the same."""


def image_batch(name: str, images: object) -> tuple[Tensor, bool]:
    """An array or a PIL image as images (B, C, H, W), and whether it was a single image.

    Shares the memory of arrays that can be written to.

    Raises:
        TypeError: it is neither; it is a PIL image of another mode than L and RGB; or its numbers are no real ones.
        ValueError: its axes are not (H, W), (H, W, C) or (B, H, W, C) with C 1 or 3.
    """
    array = _pixels(name, images)
    if array.ndim == 2:
        return _tensor(name, array)[None, None], True
    if array.ndim not in (3, 4) or array.shape[-1] not in (1, 3):
        raise ValueError(
            f"{name} as an array must be (H, W), (H, W, C) or (B, H, W, C) with C 1 or 3, got {array.shape}: "
            f"{_advice(array.shape)}"
        )
    tensor = _tensor(name, array)
    return (tensor if array.ndim == 4 else tensor[None]).permute(0, 3, 1, 2), array.ndim == 3


def descriptor_tensor(name: str, descriptor: object) -> Tensor:
    """An array as a tensor of the same shape.  Shares its memory if it can be written to.

    Raises:
        TypeError: it is no array of real numbers.
    """
    if not isinstance(descriptor, np.ndarray):
        raise TypeError(f"{name} must be a torch tensor or a NumPy array, got {type(descriptor).__name__}")
    return _tensor(name, descriptor)


def to_array(result: Tensor, single: bool = False) -> NDArray[Any]:
    """A result (B, …) as an array, without its first axis if ``single``."""
    array: NDArray[Any] = (result[0] if single else result).detach().cpu().numpy()
    return array


def is_pil(image: object) -> bool:
    """True for a PIL image.  Does not import PIL."""
    pil = sys.modules.get("PIL.Image")
    return pil is not None and isinstance(image, pil.Image)


def pil_pixels(name: str, image: Any) -> NDArray[np.uint8]:
    """The pixels of a PIL image, (H, W) or (H, W, 3).

    Raises:
        TypeError: its mode is not L or RGB.
    """
    if image.mode not in ("L", "RGB"):
        raise TypeError(f"{name} as a PIL image must have the mode L or RGB, got {image.mode}: image.convert('RGB')")
    pixels: NDArray[np.uint8] = np.array(image)
    return pixels


def _pixels(name: str, images: object) -> NDArray[Any]:
    if isinstance(images, np.ndarray):
        return images
    if is_pil(images):
        return pil_pixels(name, images)
    raise TypeError(
        f"{name} must be a torch tensor (B, C, H, W), a NumPy array (H, W) or (H, W, C), or a PIL image, got "
        f"{type(images).__name__}"
    )


def _tensor(name: str, array: NDArray[Any]) -> Tensor:
    if array.dtype.kind not in "uifb":
        raise TypeError(f"{name} must hold real numbers, got an array of dtype {array.dtype}")
    # PyTorch takes no other byte order and no odd strides, and warns about memory that is read only
    native = np.require(array, array.dtype.newbyteorder("="), ["W"])
    even = all(step >= 0 and step % native.itemsize == 0 for step in native.strides)
    return torch.from_numpy(native if even else native.copy())


def _advice(shape: tuple[int, ...]) -> str:
    if len(shape) in (3, 4) and shape[-3] in (1, 3):
        return "move the channels last, np.moveaxis(array, -3, -1)"
    if len(shape) == 3:
        return "write array[..., None] for a batch of gray images, or pass a tensor (B, C, H, W) of any C"
    return "pass a tensor (B, C, H, W) of any C"
