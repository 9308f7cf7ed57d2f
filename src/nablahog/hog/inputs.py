"""NumPy arrays and PIL images where tensors are expected, names of presets where specs are; warnings of odd images.

Tensors have the axes of PyTorch, images (B, C, H, W).  Arrays have those of the libraries they come from, channels
last: (H, W), (H, W, C) or (B, H, W, C), where C is 1 or 3.  Descriptors are (B, rows, cols, channels) in both.  An
array without the axis B gives a result without it (``docs/conventions.md``).
"""

from __future__ import annotations

import math
import sys
import warnings
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..runtime.text import describe_type, did_you_mean
from . import presets
from .checks import shortened
from .spec import COLOURS, HOGSpec

if TYPE_CHECKING:
    from PIL.Image import Image

ArrayImage: TypeAlias = "NDArray[Any] | Image"
"""An image, or a batch of them, that is not a tensor."""
Descriptors = TypeVar("Descriptors", Tensor, NDArray[Any])
"""Descriptors as tensors or arrays: a function that takes one kind returns the same."""

SAMPLE_SPACING = 8  # every eighth row and column of a large image is looked at: values in 0…255 show in any few pixels
FEW_VALUES = 2**12  # values that are all looked at
RANGE_OVERSHOOT = 1.0  # above white; filters overshoot by less
# of a sentence on dtypes
WHITE = "; divide by the value of white: write images / 65535 for 16 bits, images / 255 for 8, images / 1 for bool"
ITEMS = "one call for each of them, or torch.stack or np.stack of those of one shape"
_CALLER = 4  # frames up: this file's two, the operator, and the line that called it

DEFAULT_SPECS: dict[str, HOGSpec] = {name: getattr(presets, name)() for name in presets.__all__}
"""The dialects of all presets with their defaults."""


def as_spec(spec: HOGSpec | str) -> HOGSpec:
    """A spec, or the preset of that name with its defaults.

    Raises:
        TypeError: it is neither a spec nor a name.
        ValueError: there is no such preset.
    """
    if isinstance(spec, HOGSpec):
        return spec
    if not isinstance(spec, str):
        raise TypeError(f"spec must be a HOGSpec or the name of a preset, got {type(spec).__name__}")
    if spec not in DEFAULT_SPECS:
        names = ", ".join(DEFAULT_SPECS)
        advice = did_you_mean(spec, DEFAULT_SPECS)
        raise ValueError(f"spec must be a HOGSpec or one of {names}, got {shortened(spec)}{advice}")
    return DEFAULT_SPECS[spec]


def image_batch(name: str, images: object) -> tuple[Tensor, bool]:
    """An array or a PIL image as images (B, C, H, W), and whether it was a single image.

    Shares the memory of arrays that can be written to.

    Raises:
        TypeError: it is neither; it is a PIL image of another mode than L and RGB; or its numbers are not real.
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
        TypeError: it is not an array of real numbers.
    """
    if not isinstance(descriptor, np.ndarray):
        came = describe_type(descriptor, path="nablahog.load_descriptor(path).descriptor", items=ITEMS)
        raise TypeError(f"{name} must be a torch tensor or a NumPy array, got {came}")
    return _tensor(name, descriptor)


def to_array(result: Tensor, single: bool = False) -> NDArray[Any]:
    """A result (B, …) as an array, without its first axis if ``single``."""
    array: NDArray[Any] = (result[0] if single else result).detach().cpu().numpy()
    return array


def is_pil(image: object) -> bool:
    """True for a PIL image.  Does not import PIL."""
    pil = sys.modules.get("PIL.Image")
    return pil is not None and isinstance(image, pil.Image)


def pil_pixels(name: str, image: Any) -> NDArray[Any]:
    """The pixels of a PIL image, (H, W) or (H, W, 3), uint8; of 16 bits float32 in 0…1.

    Raises:
        TypeError: its mode is another.
    """
    if image.mode in ("L", "RGB"):
        pixels: NDArray[Any] = np.array(image)
        return pixels
    if image.mode.startswith("I;16"):
        pixels = np.array(image).astype(np.float32)
        pixels /= np.float32(65535)
        return pixels
    # convert() clips numbers of more than 8 bits
    advice = "np.asarray(image), of floats in 0…1" if image.mode in ("I", "F") else "image.convert('RGB')"
    raise TypeError(f"{name} as a PIL image must have the mode L, RGB or I;16, got {image.mode}: {advice}")


def _pixels(name: str, images: object) -> NDArray[Any]:
    if isinstance(images, np.ndarray):
        return images
    if is_pil(images):
        return pil_pixels(name, images)
    raise TypeError(
        f"{name} must be a torch tensor (B, C, H, W), a NumPy array (H, W) or (H, W, C), or a PIL image, got "
        f"{describe_type(images, path='PIL.Image.open(path)', items=ITEMS)}"
    )


def _tensor(name: str, array: NDArray[Any]) -> Tensor:
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        raise ValueError(f"{name} must have no masked entries, got an array that masks some: write array.filled(0)")
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


def warn_about_range(images: Tensor, spec: HOGSpec) -> None:
    """Warns of images (B, C, H, W) whose range or channels are seldom meant; by Python's default filter once a line.

    Other devices than the CPU are not waited for.
    """
    channels = images.shape[1]
    if channels == COLOURS + 1:
        _warn(
            "images have 4 channels, and each of them is described; of RGBA images drop the last: write images[:, :3] "
            "for tensors, image.convert('RGB') for PIL"
        )
    if channels == COLOURS and spec.colour == "gray" and spec.layout in ("blocks", "block-vector"):
        _warn(
            "images have 3 channels, which this spec makes gray (Eq. 1); scikit-image refuses them, or takes the "
            "channel of largest gradient: write presets.skimage(channel_axis=-1) for that"
        )
    if images.is_cpu and images.is_floating_point() and 1 + RANGE_OVERSHOOT < _largest_value(images) < math.inf:
        _warn(
            "images of floats have values far beyond 0…1, where 1 is white: divide those in 0…255 by 255, or pass "
            "uint8, and pass images of a network as they were before their mean was subtracted"
        )


def _largest_value(images: Tensor) -> float:
    """Of some rows and columns of large images; 0 if values are not known.  Of centred images it tells enough."""
    values = images.detach()
    try:
        if values.numel() <= FEW_VALUES:
            return values.max().item() if values.numel() else 0
        spacing = min(SAMPLE_SPACING, min(values.shape[2:]) // SAMPLE_SPACING) or 1
        # NumPy is faster with slices, and wakes no threads
        return float(np.maximum.reduce(values.numpy()[..., ::spacing, ::spacing], axis=None))
    except RuntimeError:  # tensors of torch.func's transforms have no storage
        return 0


def _warn(text: str) -> None:
    warnings.warn(text, UserWarning, stacklevel=_CALLER)
