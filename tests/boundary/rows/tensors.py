"""Batches and descriptors: tensors of other types, layouts and containers, and arrays; the plain ones are float32."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..table import Kind, Row, rows
from .arrays import HALF, Holder, masked, odd_strides, read_only

D: Kind = "descriptor"
BRAIN = 2e-2  # roundings of bfloat16
MOVED = dict.fromkeys(("to_layout", "from_layout"), "moves entries of any kind")
SHAPED = ("hog", "HOG", *MOVED, "HOGLoss", "compat.opencv", "compat.opencv.score", "scale_descriptors")
SHAPES = dict.fromkeys(SHAPED, "shapes alone are a result")
LEVELS = {"reconstruct_multiscale": "a list has a descriptor for each scale"}


def rounded(dtype: torch.dtype) -> Callable[[Tensor], Tensor]:
    """What is left of numbers in another dtype, in float32."""
    return lambda x: x.to(dtype).float()


def of_tensors(kind: Kind, prefix: str, must: Any = "be taken") -> list[Row]:
    """Other forms of tensors, which are the same for images and for descriptors."""
    forms = {
        "requires_grad": lambda x: x.clone().requires_grad_(),
        "a parameter": lambda x: torch.nn.Parameter(x.clone()),
        "every second column": lambda x: x.repeat_interleave(2, -1)[..., ::2],
        "axes in another order": lambda x: x.transpose(-1, -2).contiguous().transpose(-1, -2),
        "negated lazily": lambda x: torch.complex(torch.zeros_like(x), -x).conj().imag,
        "of inference mode": in_inference_mode,
    }
    return [Row(f"{prefix} {name}", kind, make, must=must) for name, make in forms.items()] + [
        Row(f"{prefix} float64", kind, lambda x: x.double(), tolerance=1e-5, must=must),
        Row(f"{prefix} float16", kind, lambda x: x.half(), means=rounded(torch.float16), tolerance=HALF),
        Row(f"{prefix} bfloat16", kind, lambda x: x.bfloat16(), means=rounded(torch.bfloat16), tolerance=BRAIN),
        Row(f"{prefix} complex", kind, lambda x: x.cfloat(), must="be refused", leaves_out=MOVED),
        Row(f"{prefix} sparse", kind, lambda x: x.to_sparse()),
        Row(f"{prefix} float8", kind, lambda x: x.to(torch.float8_e4m3fn), must="be refused", leaves_out=MOVED),
        Row(f"{prefix} quantized", kind, quantized, must="be refused", leaves_out=MOVED),
        Row(f"{prefix} nested", kind, lambda x: torch.nested.nested_tensor(list(x), layout=torch.jagged)),
        Row(f"{prefix} in a list", kind, list),
        Row(f"{prefix} arrays in a list", kind, lambda x: [part.numpy() for part in x], leaves_out=LEVELS),
        Row(f"{prefix} as lists of numbers", kind, lambda x: x.tolist()),
        Row(f"{prefix} in a generator", kind, lambda x: (part for part in x)),
        Row(f"{prefix} empty", kind, lambda x: x[:0], means=lambda x: x[:0]),
        Row(f"{prefix} with NaN", kind, with_nan, means=with_nan),
        Row(f"{prefix} on the device meta", kind, lambda x: x.to("meta"), must="be refused", leaves_out=SHAPES),
    ]


def in_inference_mode(x: Tensor) -> Tensor:
    with torch.inference_mode():
        return x.clone()


def quantized(x: Tensor) -> Tensor:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of PyTorch, that there is another library for it
        return torch.quantize_per_tensor(x, 1 / 255, 0, torch.quint8)


def with_nan(x: Tensor) -> Tensor:
    x = x.clone(memory_format=torch.contiguous_format)
    x.view(-1)[x.shape[-1] + 1] = float("nan")
    return x


def integers(white: int, dtype: torch.dtype) -> Callable[[Tensor], Tensor]:
    return lambda x: (x * white).round().to(dtype)


BATCHES = [
    Row(
        "batch uint8",
        "batch",
        integers(255, torch.uint8),
        must="be taken",
        leaves_out=dict.fromkeys(("reconstruct", "render"), "takes floats alone, as documented"),
    ),
    Row("batch uint16", "batch", integers(65535, torch.uint16)),
    Row("batch int16", "batch", integers(255, torch.int16)),
    Row("batch int64", "batch", integers(255, torch.int64)),
    Row("batch bool", "batch", lambda x: x > 0.5, means=lambda x: (x > 0.5).float()),
    Row("batch channels last", "batch", lambda x: x.contiguous(memory_format=torch.channels_last), must="be taken"),
    Row("batch (B, H, W)", "batch", lambda x: x[:, 0]),
    Row("batch (B, H, W, 1)", "batch", lambda x: x.permute(0, 2, 3, 1)),
    Row("batch (1, B, 1, H, W)", "batch", lambda x: x[None]),
    Row("batch array (B, H, W, 1)", "batch", lambda x: x.permute(0, 2, 3, 1).numpy()),
    Row("batch array (B, H, W)", "batch", lambda x: x[:, 0].numpy()),
    Row("batch array (B, 1, H, W)", "batch", lambda x: x.numpy()),
    Row("batch list of (H, W) uint8", "batch", lambda x: list((x[:, 0] * 255).round().numpy().astype(np.uint8))),
    *of_tensors("batch", "batch"),
]
ARRAYS_TAKEN = {
    "big-endian": lambda x: x.numpy().astype(">f4"),
    "read-only": lambda x: read_only(x.numpy()),
    "odd strides": lambda x: odd_strides(x.numpy()),
    "negative strides": lambda x: np.ascontiguousarray(x.numpy()[..., ::-1])[..., ::-1],
    "Fortran order": lambda x: np.asfortranarray(x.numpy()),
}


def eighths(x: Tensor) -> Tensor:
    return (x * 8).round()


DESCRIPTORS = [
    *of_tensors("descriptor", "descriptor"),
    Row("descriptor array", D, lambda x: x.numpy(), must="be taken"),
    Row("descriptor array float64", D, lambda x: x.double().numpy(), tolerance=1e-5, must="be taken"),
    *rows(D, ARRAYS_TAKEN, prefix="descriptor array", must="be taken"),
    Row("descriptor array float16", D, lambda x: x.half().numpy(), means=rounded(torch.float16), tolerance=HALF),
    Row("descriptor array masked somewhere", D, lambda x: masked(x.numpy(), True), must="be refused"),
    Row("descriptor array of objects", D, lambda x: x.numpy().astype(object)),
    Row("descriptor array int64", D, lambda x: eighths(x).long().numpy(), means=eighths),
    Row("descriptor int64", D, lambda x: eighths(x).long(), means=eighths),
    Row("descriptor without its first axis", D, lambda x: x[0], means=lambda x: x[:1]),
    Row("descriptor array without its first axis", D, lambda x: x[0].numpy(), means=lambda x: x[:1]),
    Row("descriptor with one more axis", D, lambda x: x[None]),
    Row("descriptor flat", D, lambda x: x.flatten()),
    Row("descriptor what becomes an array", D, lambda x: Holder(x.numpy())),
    *[
        Row(f"no descriptor: {name}", "descriptor", lambda _, value=value: value, must="be refused")
        for name, value in {
            "None": None,
            "a number": 3,
            "a path": "d.npz",
            "a dict": {"x": 1},
            "an empty list": [],
        }.items()
    ],
]
ROWS = [*BATCHES, *DESCRIPTORS]
