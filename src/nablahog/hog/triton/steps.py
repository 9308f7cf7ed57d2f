"""The two passes over pixels in Triton, as functions of PyTorch; cells are normalised by the reference."""

from __future__ import annotations

import torch
from torch import Tensor

from ..autograd import Step, apply, cells_reference, jvp_by_vjp
from ..spec import HOGSpec
from ..steps import merge_colours, normalize_reference, split_colours, spread_nan
from . import launch


def _cells(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Cells (B, rows, cols, colours · bins), and which of the images (B, colours) are not finite."""
    cells, flags = launch.cells(images, spec)
    finite = torch.where(flags.reshape(-1, 1, 1, 1) != 0, torch.nan, cells)
    return merge_colours(finite, spec), flags.reshape(-1, spec.colours)


def _cells_vjp(images: Tensor, flags: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    return launch.cells_vjp(images, flags.flatten(), split_colours(grad_output, spec).contiguous(), spec)


def _cells_jvp(images: Tensor, _: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    return jvp_by_vjp(lambda of: cells_reference(of, spec), (images,), (tangents,))


CELLS = Step(_cells, _cells_vjp, _cells_jvp, cells_reference)


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """Cell histograms (B, colours · bins, rows, cols) of images (B, C, H, W), float16 and bfloat16 included."""
    spec.grid(*images.shape[2:])
    return apply(CELLS, images, spec).permute(0, 3, 1, 2)


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels)."""
    descriptor = spread_nan(normalize_reference(histograms(images, spec), spec), images)
    return descriptor.permute(0, 2, 3, 1).contiguous()


@torch.no_grad()
def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """Eq. 1-6 without a graph: images (B, C, H, W) to cells (B, rows, cols, colours · bins)."""
    return _cells(images, spec)[0].contiguous()


@torch.no_grad()
def cells_vjp(images: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients with respect to the images from those with respect to the cells."""
    return _cells_vjp(images, _cells(images, spec)[1], grad_output, spec).contiguous()


def describe_vjp(images: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients with respect to the images from those with respect to the descriptors."""
    with torch.enable_grad():
        x = images.requires_grad_()
        return torch.autograd.grad(describe(x, spec), x, grad_output)[0]
