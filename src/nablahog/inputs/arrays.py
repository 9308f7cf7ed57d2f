"""Images, descriptors and masks of PyTorch, NumPy and PIL as tensors, and results as arrays again.

Tensors have the axes of PyTorch, images (B, C, H, W).  Arrays have those of the libraries they come from, channels
last: (H, W), (H, W, C) or (B, H, W, C), where C is 1 or 3.  An array without the axis B gives a result without it
(``docs/conventions.md``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..runtime.advice import warn_caller
from ..runtime.text import describe_type
from .pil_images import is_pil, load_pixels, pil_pixels
from .tensors import check_dense, read_tensor

if TYPE_CHECKING:
    from PIL.Image import Image

ArrayImage: TypeAlias = "NDArray[Any] | Image"
"""An image, or a batch of them, that is not a tensor."""
Descriptors = TypeVar("Descriptors", Tensor, NDArray[Any])
"""Descriptors as tensors or arrays: a function that takes one kind returns the same."""

ITEMS = "one call for each of them, or torch.stack or np.stack of those of one shape"
SAMPLE_SPACING = 8  # every eighth row and column of a large image is looked at: values in 0…255 show in any few pixels
FEW_VALUES = 2**12  # values that are all looked at
LEVEL_OVERSHOOT = 1.0  # above white; filters overshoot by less
LEVEL_UNDERSHOOT = 0.5  # below black; images in -1…1 go beyond

AS_GRAY = "image.convert('L') of a PIL image, image[..., 0] of an array (H, W, 1), image[0] of a tensor (1, H, W)"

# of a sentence on dtypes
WHITE = "; divide by the value of white: write images / 65535 for 16 bits, images / 255 for 8, images / 1 for bool"


def as_images(name: str, images: object) -> tuple[Tensor, bool]:
    """Images (B, C, H, W) of a tensor, which is left as it is, an array or a PIL image; and whether it was one image
    without the axis B.

    Shares the memory of arrays that can be written to.

    Raises:
        TypeError: it is none of them, a tensor is nested or sparse, or the numbers of an array are not real.
        ValueError: the axes of an array are not (H, W), (H, W, C) or (B, H, W, C) with C 1 or 3; it masks some pixels;
            or the levels of a PIL image are none of a photograph.
    """
    if isinstance(images, Tensor):
        check_dense(name, images)
        return images, False
    if is_pil(images):
        array = pil_pixels(name, images)  # type: ignore[arg-type]
    elif isinstance(images, np.ndarray):
        array = images
    else:
        raise TypeError(
            f"{name} must be a torch tensor (B, C, H, W), a NumPy array (H, W) or (H, W, C), or a PIL image, got "
            f"{describe_type(images, path='PIL.Image.open(path)', items=ITEMS)}{_advise_on_holder(images)}"
        )
    if array.ndim == 2:
        return as_tensor(name, array)[None, None], True
    if array.ndim not in (3, 4) or array.shape[-1] not in (1, 3):
        raise ValueError(
            f"{name} as an array must be (H, W), (H, W, C) or (B, H, W, C) with C 1 or 3, got {array.shape}: "
            f"{advise_on_axes(array.shape)}"
        )
    tensor = as_tensor(name, array)
    return (tensor if array.ndim == 4 else tensor[None]).permute(0, 3, 1, 2), array.ndim == 3


def _advise_on_holder(value: object) -> str:
    """What to write for what becomes an array, as tables and files of arrays do."""
    return ": write np.asarray(…) of it" if hasattr(value, "__array__") or hasattr(value, "__dlpack__") else ""


def advise_on_axes(shape: tuple[int, ...]) -> str:
    """What to write for an array of images that has other axes."""
    if len(shape) in (3, 4) and shape[-3] in (1, 3):
        return "move the channels last, np.moveaxis(array, -3, -1)"
    if len(shape) in (3, 4) and shape[-1] == 4:
        write = "PIL.Image.fromarray(array)" if len(shape) == 3 else "each PIL.Image.fromarray(array[k])"
        return f"of RGBA in uint8 pass {write}, which is put over white"
    if len(shape) == 3:
        return "write array[..., None] for a batch of gray images, or pass a tensor (B, C, H, W) of any C"
    return "pass a tensor (B, C, H, W) of any C"


def as_unit_range(name: str, images: object) -> tuple[Tensor, bool]:
    """:func:`as_images` in floats in 0…1; TypeError for other dtypes than floats and uint8."""
    batch, is_single = as_images(name, images)
    if batch.dtype != torch.uint8 and not batch.is_floating_point():
        raise TypeError(f"{name} must be floats in 0…1, or uint8 in 0…255, got {batch.dtype}{WHITE}")
    return batch / 255 if batch.dtype == torch.uint8 else batch, is_single


def as_photograph(name: str, photograph: object) -> Tensor:
    """One photograph (C, H, W), C 1 or 3, finite floating point numbers or uint8, of a tensor, array or PIL image.

    Derivatives by it are not recorded.

    Raises:
        TypeError: it is none of them.
        ValueError: it is a batch, has other axes or another dtype, or holds NaN or infinity.
    """
    if isinstance(photograph, Tensor):
        image = photograph.detach()
    else:
        images, is_single = as_images(name, photograph)
        if not is_single:
            raise ValueError(f"{name} must be one image, got a batch of {len(images)}: write one call for each of them")
        image = images[0]
    is_numeric = image.is_floating_point() or image.dtype == torch.uint8
    if image.dim() != 3 or image.shape[0] not in (1, 3) or not is_numeric:
        last = image.shape[-1:] in ((1,), (3,))
        write = {2: "photograph[None]", 3: "photograph.permute(2, 0, 1)" if last else "", 4: "photograph[0]"}
        advice = f": write {write[image.dim()]}" if write.get(image.dim()) else ""
        raise ValueError(
            f"{name} must be a tensor (1 or 3, H, W) of floating point numbers or uint8, "
            f"got {image.dtype} of shape {tuple(image.shape)}{advice if is_numeric else WHITE}"
        )
    # the sum takes a tenth of the time, and is infinite for hardly any finite photograph
    if image.dtype != torch.uint8 and not math.isfinite(image.sum()) and not torch.isfinite(image).all():
        raise ValueError(f"{name} must be finite, got NaN or Inf")
    return image


def warn_about_levels(images: Tensor) -> None:
    """Warns of images far beyond 0…1."""
    advice = advise_on_levels(images)
    if advice:
        warn_caller(advice)


def advise_on_levels(images: Tensor) -> str:
    """What to do with images (…, H, W) far beyond 0…1; empty for others.

    Some rows and columns are looked at if they are large.  Other devices than the CPU are not waited for.
    """
    if not (images.is_cpu and images.is_floating_point() and images.numel()):
        return ""
    values = images.detach()
    try:
        if values.numel() <= FEW_VALUES:
            least, largest = (value.item() for value in values.aminmax())
        else:  # NumPy is faster with slices, and wakes no threads
            spacing = min(SAMPLE_SPACING, min(values.shape[-2:]) // SAMPLE_SPACING) or 1
            sample = values.numpy()[..., ::spacing, ::spacing]
            largest = float(np.maximum.reduce(sample, axis=None))
            least = float(np.minimum.reduce(sample[..., ::2, ::2], axis=None))
    except (RuntimeError, TypeError):  # tensors of torch.func's transforms have no storage, and bfloat16 no array
        return ""
    if 1 + LEVEL_OVERSHOOT < largest < math.inf or -math.inf < least < -LEVEL_UNDERSHOOT:
        return (
            "images of floats have values far beyond 0…1, where 1 is white: divide those in 0…255 by 255, or pass "
            "uint8; of those in -1…1, pass (images + 1) / 2; and pass images of a network as they were before their "
            "mean was subtracted"
        )
    return ""


def as_gray(name: str, image: object) -> NDArray[np.float64]:
    """A gray image (H, W), bytes over 255, of a tensor, an array, a PIL image or nested lists; other axes are left.

    Raises:
        TypeError: its numbers are not real, or the lengths of its lists differ.
        ValueError: it masks some pixels, or has no values.
    """
    values = pil_pixels(name, image) if is_pil(image) else as_array(name, image)  # type: ignore[arg-type]
    gray: NDArray[np.float64] = values.astype(np.float64)
    return gray / 255 if values.dtype == np.uint8 else gray


def as_mask(name: str, mask: object, size: tuple[int, int]) -> Tensor:
    """A mask (H, W) of an image of that size, bool, true somewhere, of a tensor, an array or nested lists.

    Raises:
        TypeError: it is a PIL image, or nothing of that kind.
        ValueError: it has another shape or dtype, masks some entries, or is nowhere true.
    """
    if is_pil(mask):
        raise TypeError(f"{name} must be bool, got a PIL image: write np.asarray(image.convert('L')) > 0")
    try:
        tensor = as_tensor(name, mask) if isinstance(mask, np.ndarray) else torch.as_tensor(mask, device="cpu")
    except (TypeError, RuntimeError):
        came = f"an array of {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise TypeError(
            f"{name} must be a tensor or an array of bool, got {came}: of an image write "
            "np.asarray(image.convert('L')) > 0"
        ) from None
    if tensor.dtype != torch.bool or tuple(tensor.shape) != size:
        write = ": write mask > 0" if tensor.dtype != torch.bool else ""
        dtype = str(tensor.dtype).removeprefix("torch.")
        raise ValueError(f"{name} must be bool of shape {size}, got {dtype} of shape {tuple(tensor.shape)}{write}")
    if not bool(tensor.any()):
        raise ValueError(f"{name} must be true where the object is, got one that is true nowhere")
    return tensor


def as_descriptors(name: str, descriptor: object) -> tuple[Tensor, bool]:
    """Descriptors with B as their first of four axes, and whether an array lacked it.  Shares the memory of arrays that
    can be written to.

    Raises:
        TypeError: it is neither a dense tensor nor an array, or its numbers are not real.
        ValueError: it is an array that masks some entries.
    """
    if isinstance(descriptor, Tensor):
        check_dense(name, descriptor)
        if descriptor.is_complex():
            raise TypeError(f"{name} must hold real numbers, got {descriptor.dtype}: write descriptor.real")
        return descriptor, False
    if not isinstance(descriptor, np.ndarray):
        came = describe_type(descriptor, path="nablahog.load_descriptor(path).descriptor", items=ITEMS)
        raise TypeError(f"{name} must be a torch tensor or a NumPy array, got {came}{_advise_on_holder(descriptor)}")
    tensor = as_tensor(name, descriptor)
    return (tensor[None], True) if tensor.dim() == 3 else (tensor, False)


def as_tensor(name: str, array: NDArray[Any]) -> Tensor:
    """An array as a tensor of the same shape.  Shares its memory if it can be written to.

    Raises:
        TypeError: its numbers are not real.
        ValueError: it masks some entries.
    """
    check_unmasked(name, array)
    if array.dtype.kind not in "uifb":
        write = ": write np.stack(array) of vectors, array.astype(float) of numbers" if array.dtype == object else ""
        raise TypeError(f"{name} must hold real numbers, got an array of dtype {array.dtype}{write}")
    # PyTorch takes no other byte order and no odd strides and no longer floats, and warns of memory that is read only
    dtype = np.dtype(np.float64) if array.dtype == np.longdouble else array.dtype.newbyteorder("=")
    native = np.require(array, dtype, ["W"])
    even = all(step >= 0 and step % native.itemsize == 0 for step in native.strides)
    return torch.from_numpy(native if even else native.copy())


def as_array(name: str, values: object) -> NDArray[Any]:
    """Real numbers of an array, a tensor, nested lists or what NumPy makes an array of; objects become float64, and
    arrays of one shape as objects one array.

    Derivatives by a tensor are not recorded.

    Raises:
        TypeError: they are no real numbers, their lists differ in length, or a tensor is nested or sparse.
        ValueError: an array masks some of them, or a tensor has no values.
    """
    if isinstance(values, Tensor):
        check_dense(name, values)
        values = read_tensor(name, values)
    check_unmasked(name, values)
    if is_pil(values):
        load_pixels(name, values)  # type: ignore[arg-type]
    with suppress(TypeError, ValueError, OverflowError, RuntimeError):
        array = np.asarray(values)
        if array.dtype == object and len(array) and all(isinstance(value, np.ndarray) for value in array.flat):
            array = np.stack(array.tolist())  # a column of a data frame
        if array.dtype == object and not any(value is None for value in array.flat):  # which would be NaN
            array = array.astype(np.float64)
        if array.dtype.kind in "uifb":
            return array
    came = describe_type(values, path="PIL.Image.open(path)", items=ITEMS)
    if isinstance(values, np.ndarray):
        came = f"an array of dtype {values.dtype}{': write array.real' if values.dtype.kind == 'c' else ''}"
    elif isinstance(values, Iterator):
        came += ": write list(…) of it"
    elif hasattr(values, "toarray"):  # of SciPy
        came += ": write its toarray()"
    raise TypeError(f"{name} must be an array of real numbers, got {came}")


def check_unmasked(name: str, array: object) -> None:
    """Raises ValueError for an array that masks some entries, which would count as if they were not masked."""
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        raise ValueError(f"{name} must have no masked entries, got an array that masks some: write array.filled(0)")


def to_array(result: Tensor, single: bool = False) -> NDArray[Any]:
    """A result (B, …) as an array, without its first axis if ``single``."""
    return read_tensor("the result", result[0] if single else result)
