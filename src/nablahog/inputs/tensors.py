"""Checks of tensors, and their values as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .pil_images import is_pil


def check_dense(name: str, tensor: Tensor) -> None:
    """Raises TypeError for a nested, sparse or quantized tensor, whose numbers the loops cannot read."""
    if tensor.is_nested:
        raise TypeError(f"{name} must be a dense tensor, got a nested one: write one call for each of its parts")
    if tensor.layout is not torch.strided:
        raise TypeError(f"{name} must be a dense tensor, got {tensor.layout}: write tensor.to_dense()")
    if tensor.is_quantized:
        raise TypeError(f"{name} must hold plain numbers, got {tensor.dtype}: write tensor.dequantize()")
    if tensor.is_floating_point() and tensor.element_size() < 2:  # float8, which has no arithmetic
        raise TypeError(f"{name} must be floats of at least 16 bits, got {tensor.dtype}: write tensor.float()")


def check_values(name: str, tensor: Tensor, write: str = "") -> None:
    """Raises ValueError for a tensor that has a shape and no values to read, with what to ``write`` for it."""
    try:
        bool(tensor.detach()[(slice(1),) * tensor.dim()].isfinite().all())
    except RuntimeError:
        advice = "call the function outside of torch.vmap and torch.export, with all of the batch"
        if tensor.is_meta:
            advice = "pass one on the CPU or a GPU, not on the device meta"
        elif write:
            advice = f"write {write}"
        raise ValueError(f"{name} must be a tensor whose values can be read: {advice}") from None


def read_tensor(name: str, tensor: Tensor, write: str = "") -> NDArray[Any]:
    """The values of a dense tensor, without its derivative; of bfloat16 in float32.

    Raises:
        ValueError: they cannot be read, see :func:`check_values`.
    """
    values = (tensor.float() if tensor.dtype == torch.bfloat16 else tensor).detach().resolve_neg().resolve_conj()
    try:
        array: NDArray[Any] = values.cpu().numpy()
    except RuntimeError:
        check_values(name, tensor, write)
        # in torch.func.grad and jvp tensors have values, but show no memory
        array = np.array(values.tolist(), str(values.dtype).removeprefix("torch.")).reshape(values.shape)
    return array


def check_shape(name: str, tensor: object, shape: tuple[int | str, ...]) -> Tensor:
    """A dense tensor of floating point numbers with these sides, of which those with a name have any length.

    Raises:
        TypeError: it is no tensor, or a nested or sparse one.
        ValueError: it has other sides or another dtype.
    """
    expected = f"{name} must be a tensor ({', '.join(map(str, shape))}) of floating point numbers"
    if not isinstance(tensor, Tensor):
        raise TypeError(f"{expected}, got {type(tensor).__name__}{advise_on_tensor(name, tensor)}")
    check_dense(name, tensor)
    sides = zip(tensor.shape, shape, strict=False)
    if tensor.dim() != len(shape) or any(isinstance(side, int) and length != side for length, side in sides):
        raise ValueError(f"{expected}, got shape {tuple(tensor.shape)}")
    if not tensor.is_floating_point():
        raise ValueError(f"{expected}, got {tensor.dtype}: write .float() of real numbers")
    return tensor


def check_device(name: str, tensor: Tensor, other_name: str, other: Tensor) -> None:
    """Raises ValueError unless both tensors are on one device."""
    if tensor.device != other.device:
        noun, other_noun = name.split()[-1], other_name.split()[-1]
        raise ValueError(
            f"{name} and {other_name} must be on one device, got {tensor.device} and {other.device}: write "
            f"{noun}.to({other_noun}.device)"
        )


def advise_on_tensor(name: str, value: object) -> str:
    """What to write for an array, a PIL image or lists of numbers that must be a tensor; nothing for all else."""
    noun = name.split()[-1]
    if isinstance(value, np.ndarray):
        return f": write torch.from_numpy({noun})"
    if is_pil(value):
        return f": write torch.from_numpy(np.array({noun}.convert('RGB'))).permute(2, 0, 1)[None]"
    return f": write torch.tensor({noun})" if isinstance(value, list | tuple) else ""


def check_floats(name: str, tensor: object) -> None:
    """Raises TypeError unless ``tensor`` is one of float32 or float64."""
    if isinstance(tensor, Tensor):
        check_dense(name, tensor)
    got = tensor.dtype if isinstance(tensor, Tensor) else type(tensor).__name__
    if got not in (torch.float32, torch.float64):
        noun = name.split()[-1]
        cast = f": write {noun}.float(), {noun}.astype('f4') of an array"
        write = cast if isinstance(tensor, Tensor) else advise_on_tensor(name, tensor)
        raise TypeError(f"{name} must be a float32 or float64 tensor, got {got}{write}")


def check_finite(name: str, tensor: Tensor) -> None:
    """Raises ValueError if ``tensor`` holds NaN or Inf, or no values."""
    check_values(name, tensor)
    if not torch.isfinite(tensor).all():
        raise ValueError(f"{name} must be finite, got NaN or Inf")
