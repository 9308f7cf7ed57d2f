"""Which engine computes the steps: native loops on a CPU, Triton's kernels on a GPU, or the reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import torch
from torch import Tensor
from torch.autograd import forward_ad

from ..runtime.forward_mode import load_forward_mode
from . import kernels
from . import triton as gpu
from .autograd import in_graph
from .spec import HOGSpec
from .steps import histograms_reference, normalize_reference, spread_nan

Backend: TypeAlias = Literal["auto", "torch", "triton"]
Step: TypeAlias = Callable[[Tensor, HOGSpec], Tensor]


def on_gpu(images: Tensor, spec: HOGSpec, backend: Backend) -> bool:
    """Whether Triton's kernels are to compute it.  Raises if they were asked for and cannot."""
    if backend == "triton":
        gpu.check(images.device, spec)
    return backend == "triton" or (backend == "auto" and gpu.chosen(images.device, spec))


def _on_cpu(images: Tensor, spec: HOGSpec, backend: Backend) -> bool:
    return backend == "auto" and images.is_cpu and kernels.supports(spec)


def histograms(images: Tensor, spec: HOGSpec, *, backend: Backend = "auto") -> Tensor:
    """Cell histograms (B, colours · bins, rows, cols) of images that :func:`.hog` takes: float32, float64 or uint8."""
    native, triton = _on_cpu(images, spec, backend), on_gpu(images, spec, backend)
    if (native or (triton and images.is_cuda)) and in_graph(images):
        from . import operators

        spec.grid(*images.shape[2:])
        cells: Tensor = operators.cells(images, spec.to_json())
        return cells.permute(0, 3, 1, 2)
    if native:
        return kernels.histograms(images, spec)
    if triton:
        from .triton import steps

        return steps.histograms(images, spec)
    spec.grid(*images.shape[-2:])  # or it is too small; the engines check this with their cached tables
    return histograms_reference(images, spec)


def describe(images: Tensor, spec: HOGSpec, *, backend: Backend = "auto") -> Tensor:
    """:func:`.hog` of images as it takes them, float32, float64 or uint8, without its checks and warnings."""
    if _on_cpu(images, spec, backend) and spec.normalizer.has_loops:
        if not in_graph(images):
            return kernels.describe(images, spec)
        from . import operators

        spec.grid(*images.shape[2:])
        descriptors: Tensor = operators.describe(images, spec.to_json())
        return descriptors
    if images.is_meta:  # a graph, but no values
        shape = len(images), *spec.grid(*images.shape[-2:]), spec.channels
        dtype = images.dtype if images.is_floating_point() else torch.get_default_dtype()
        return images.to(dtype).sum((1, 2, 3)).reshape(-1, 1, 1, 1).expand(shape).contiguous()
    descriptor = normalize_reference(histograms(images, spec, backend=backend), spec)  # Eq. 7
    return spread_nan(descriptor, images).permute(0, 2, 3, 1).contiguous()


def _norm(of_cells: Tensor, spec: HOGSpec) -> Tensor:
    return normalize_reference(of_cells, spec) if in_graph(of_cells) else kernels.norm(of_cells, spec)


def steps(device: torch.device, spec: HOGSpec) -> tuple[Step, Step]:
    """The fastest ``histograms`` of images on the device, and ``normalize``, of the dialect."""
    native = device.type == "cpu" and kernels.supports(spec)
    norm = _norm if native and spec.normalizer.has_loops else normalize_reference
    return (histograms if native or gpu.chosen(device, spec) else histograms_reference), norm


def histograms_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, colours · bins, rows, cols) from those of the images (B, C, H, W)."""
    if images.is_cpu and kernels.supports(spec):
        return kernels.histograms_jvp(images, tangents, spec)
    load_forward_mode()
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(images.detach(), tangents)  # type: ignore[no-untyped-call]
        return forward_ad.unpack_dual(histograms_reference(dual, spec)).tangent  # type: ignore[no-any-return, no-untyped-call]
