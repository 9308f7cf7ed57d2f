"""The steps in Triton as functions of PyTorch, and as the operators of ``torch.library`` on CUDA devices."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from ..colours import merge_colours, split_colours
from ..kernels import autograd, operators
from ..spec import HOGSpec
from ..steps import histograms_reference, normalize_reference, spread_nan
from . import launch
from .launch import Cells
from .normalizers import NormalizerKernels


@lru_cache(maxsize=64)
def _norm_of(spec: HOGSpec) -> NormalizerKernels:
    kernels: NormalizerKernels = spec.normalizer.triton(spec.bins, spec.signed)
    return kernels


def _saved(cells: Cells, spec: HOGSpec) -> Tensor:
    """All of it, one row an image."""
    colours, (each, numbers) = spec.colours, cells.values.shape
    return cells.values.reshape(each // colours, colours * numbers)


def _restored(saved: Tensor, images: Tensor, spec: HOGSpec) -> Cells:
    """The inverse of :func:`_saved`."""
    rows, cols = spec.cells(*images.shape[2:])
    values = saved.reshape(len(saved) * spec.colours, saved.shape[1] // spec.colours)
    return launch.cells_of(values, (rows, cols, spec.bins))


def _plain(histograms: Tensor, spec: HOGSpec) -> Cells:
    """Cells (B, rows, cols, colours · bins) of which no image is flagged."""
    each = split_colours(histograms, spec).contiguous()
    return Cells(each.flatten(1), each.new_zeros(len(each)), (each.shape[1], each.shape[2], spec.bins))


def _cells(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    cells = launch.cells(images, spec)
    return merge_colours(cells.histograms(), spec), _saved(cells, spec)


def _cells_vjp(images: Tensor, saved: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    flags = _restored(saved, images, spec).flags
    return launch.cells_vjp(images, flags, split_colours(grad_output, spec).contiguous(), spec)


def _cells_jvp(images: Tensor, _: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    return merge_colours(launch.cells_jvp(images, tangents, spec).histograms(), spec)


def _norm(histograms: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    descriptor = _norm_of(spec).normalize(_plain(histograms, spec))
    return merge_colours(descriptor, spec), histograms.new_empty(len(histograms), 0)


def _norm_vjp(histograms: Tensor, _: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    grad = split_colours(grad_output, spec).contiguous()
    return merge_colours(_norm_of(spec).vjp(_plain(histograms, spec), grad), spec)


def _norm_jvp(histograms: Tensor, _: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    changes = split_colours(tangents, spec).contiguous()
    return merge_colours(_norm_of(spec).jvp(_plain(histograms, spec), changes), spec)


def _describe(images: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    cells = launch.cells(images, spec)
    return merge_colours(_norm_of(spec).normalize(cells), spec), _saved(cells, spec)


def _describe_vjp(images: Tensor, saved: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    cells = _restored(saved, images, spec)
    grad = _norm_of(spec).vjp(cells, split_colours(grad_output, spec).contiguous())
    return launch.cells_vjp(images, cells.flags, grad, spec)


def _describe_jvp(images: Tensor, saved: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    cells, changes = _restored(saved, images, spec), launch.cells_jvp(images, tangents, spec)
    tangent = changes.values[:, : changes.numbers].reshape(-1, *changes.shape).contiguous()
    moved = _norm_of(spec).jvp(cells, tangent)
    return merge_colours(moved, spec)


def _cells_reference(images: Tensor, spec: HOGSpec) -> Tensor:
    return histograms_reference(images, spec).permute(0, 2, 3, 1)


def _norm_reference(histograms: Tensor, spec: HOGSpec) -> Tensor:
    return normalize_reference(histograms.permute(0, 3, 1, 2), spec).permute(0, 2, 3, 1)


CELLS = autograd.Step(_cells, _cells_vjp, _cells_jvp, _cells_reference)
NORM = autograd.Step(_norm, _norm_vjp, _norm_jvp, _norm_reference)
DESCRIBE = autograd.Step(
    _describe,
    _describe_vjp,
    _describe_jvp,
    lambda images, spec: _norm_reference(_cells_reference(images, spec), spec),
)


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels) of images (B, C, H, W), float16 and bfloat16 included."""
    if not spec.normalizer.has_triton:
        descriptor = spread_nan(normalize_reference(histograms(images, spec), spec), images)
        return descriptor.permute(0, 2, 3, 1).contiguous()
    spec.grid(*images.shape[2:])
    if autograd.in_graph(images) and images.is_cuda:
        described: Tensor = operators.describe(images, spec.to_json())
        return described
    return autograd.apply(DESCRIBE, images, spec)


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """Cell histograms (B, colours · bins, rows, cols) of images (B, C, H, W)."""
    spec.grid(*images.shape[2:])
    in_graph = autograd.in_graph(images) and images.is_cuda
    cells = operators.cells(images, spec.to_json()) if in_graph else autograd.apply(CELLS, images, spec)
    return cells.permute(0, 3, 1, 2)


def norm(of_cells: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cell histograms (B, colours · bins, rows, cols) to (B, channels, rows, cols)."""
    if autograd.in_graph(of_cells) or not spec.normalizer.has_triton:
        return normalize_reference(of_cells, spec)
    return autograd.apply(NORM, of_cells.permute(0, 2, 3, 1), spec).permute(0, 3, 1, 2)


def histograms_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, colours · bins, rows, cols) from those of the images (B, C, H, W)."""
    changes = launch.cells_jvp(images.detach(), tangents.detach(), spec).histograms()
    return merge_colours(changes, spec).permute(0, 3, 1, 2)


# The operators on CUDA devices.  Their dialect is a string, its JSON.


@torch.no_grad()
def cells_operator(images: Tensor, spec: str) -> Tensor:
    """Eq. 1-6: images (B, C, H, W) to cells (B, rows, cols, colours · bins)."""
    return _cells(images, operators.spec_of(spec))[0].contiguous()


@torch.no_grad()
def cells_vjp_operator(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    """Gradients with respect to the images from those with respect to the cells."""
    dialect = operators.spec_of(spec)
    return _cells_vjp(images, _saved(launch.cells(images, dialect), dialect), grad_output, dialect).contiguous()


@torch.no_grad()
def describe_operator(images: Tensor, spec: str) -> Tensor:
    """Images (B, C, H, W) to descriptors (B, rows, cols, channels)."""
    return _describe(images, operators.spec_of(spec))[0].contiguous()


@torch.no_grad()
def describe_vjp_operator(images: Tensor, grad_output: Tensor, spec: str) -> Tensor:
    """Gradients with respect to the images from those with respect to the descriptors."""
    dialect = operators.spec_of(spec)
    return _describe_vjp(images, _saved(launch.cells(images, dialect), dialect), grad_output, dialect).contiguous()
