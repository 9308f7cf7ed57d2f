"""From unknowns to images: in the basis of the orthonormal cosine transform, DCT-II, with exactly flat regions.

On a CPU the transform is SciPy's, elsewhere products with the matrix of cosines.

A normaliser amplifies the faintest texture to full strength, so "almost flat" and "flat" have very different
descriptors, with a plateau between them where no descent makes progress.  Photographs do have exactly flat, saturated
regions.  Where the descriptor of a cell is zero, every pixel that votes into it has no gradient: there the image is
constant by construction, one gray value for each connected region.
"""

from __future__ import annotations

import math
from ctypes import c_bool, c_int64
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy import fft, ndimage
from torch import Tensor

from .. import native
from ..hog.entries import cell_entries, covered_cells, fill_from_nearest
from ..hog.spec import HOGSpec
from ..hog.steps import pooling_axes


@lru_cache(maxsize=16)  # kept on the device: a copy from the CPU would stall it
def cosines(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The orthonormal DCT-II matrix (n, n)."""
    with torch.inference_mode(False):
        k, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64),) * 2, indexing="ij")
        matrix = torch.cos(math.pi * k * (x + 0.5) / n) * math.sqrt(2 / n)
        matrix[0] /= math.sqrt(2)
        return matrix.to(device, dtype)


def to_cosines(images: Tensor) -> Tensor:
    """The orthonormal DCT-II of images (..., H, W), differentiable in either mode."""
    return _transform(images, inverse=False)


def from_cosines(coefficients: Tensor) -> Tensor:
    """Images (..., H, W) from their :func:`to_cosines`, differentiable in either mode."""
    return _transform(coefficients, inverse=True)


def _transform(planes: Tensor, inverse: bool) -> Tensor:
    if planes.device.type != "cpu":
        rows, cols = (cosines(n, planes.dtype, planes.device) for n in planes.shape[-2:])
        return rows.T @ planes @ cols if inverse else rows @ planes @ cols.T
    if not torch.is_grad_enabled():  # saves the overhead of autograd
        return _on_cpu(planes, inverse)
    out: Tensor = _OnCpu.apply(planes, inverse)  # type: ignore[no-untyped-call]
    return out


def _on_cpu(planes: Tensor, inverse: bool) -> Tensor:
    transform = fft.idctn if inverse else fft.dctn
    return torch.from_numpy(transform(planes.numpy(), axes=(-2, -1), norm="ortho", workers=torch.get_num_threads()))


class _OnCpu(torch.autograd.Function):
    """The transform on a CPU, or its inverse: orthonormal, so each is the other's adjoint."""

    @staticmethod
    def forward(planes: Tensor, inverse: bool) -> Tensor:
        return _on_cpu(planes.detach(), inverse)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.inverse = inputs[1]

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return _transform(grad_output, not ctx.inverse), None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, _: None) -> Tensor:
        return _transform(tangent, ctx.inverse)


class CosineBasis:
    """Unknowns (A, H·W): cosine coefficients of images (A, 1, H, W), in units of 1/f^exponent at spatial frequency f.

    HOG sees only differences, which are weakest in smooth components, so pixel unknowns converge last there.  Natural
    images have amplitudes of about 1/f: in these units all unknowns have about the same size, and the first descent
    step from a nearly flat image already integrates the gradient field (exponent 1 solves Poisson's equation).
    """

    def __init__(self, height: int, width: int, like: Tensor, exponent: float = 1.0) -> None:
        # half-cycles across the longer side; the mean, of frequency 0, gets the lowest other frequency
        scale = max(height, width)
        fy, fx = (torch.arange(n, dtype=torch.float32) * scale / n for n in (height, width))
        frequency = torch.sqrt(fy.square().unsqueeze(1) + fx.square()).clamp(min=1)
        self.weights = frequency.pow(-exponent).to(like)

    def image(self, unknowns: Tensor) -> Tensor:
        """Unknowns (A, H·W) to images (A, 1, H, W), in memory of its own."""
        return from_cosines(unknowns.reshape(-1, 1, *self.weights.shape) * self.weights)

    def unknowns(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to unknowns (A, H·W)."""
        return (to_cosines(image) / self.weights).flatten(1)

    def adjoint(self, grad_image: Tensor) -> Tensor:
        """Gradients with respect to images (A, 1, H, W) to those with respect to the unknowns (A, H·W)."""
        return (to_cosines(grad_image) * self.weights).flatten(1)


def low_pass(image: Tensor, sigma: float) -> Tensor:
    """Images (A, 1, H, W) convolved with a Gaussian of ``sigma`` pixels, mirrored at the borders."""
    damping = [
        torch.exp(-0.5 * (math.pi * sigma * torch.arange(n, dtype=torch.float64) / n) ** 2) for n in image.shape[-2:]
    ]
    return from_cosines(to_cosines(image) * torch.outer(*damping).to(image))


_INTEGERS, _REALS = native.array(np.int64), native.array(np.float32, np.float64)
_level = native.function(
    "level_regions", c_bool, c_int64, c_int64, *[_INTEGERS] * 3, c_int64, native.array(np.float64), _REALS
)


class FlatRegions:
    """Replaces each region that must be constant by its mean.  Linear; the identity if there is no such region."""

    def __init__(self, descriptor: Tensor, spec: HOGSpec, height: int, width: int) -> None:
        entries = fill_from_nearest(cell_entries(descriptor, spec), spec, (height, width))
        rows, cols = (covered.to(descriptor.device) for covered in covered_cells(spec, (height, width)))
        empty = (entries == 0).all(dim=1) & rows.unsqueeze(1) & cols
        axes = pooling_axes(spec, height, width, descriptor)
        down, across = (along.map(lambda weights: (weights > 0).to(weights)) for along in axes)
        without_gradient = across.spread(down.spread(empty.to(descriptor), -2), -1) > 0
        # a pixel without gradient has equal neighbours; giving it their value, too, is the smoothest choice
        cross = ndimage.generate_binary_structure(2, 1)[np.newaxis]
        constant_pixels = ndimage.binary_dilation(without_gradient.cpu().numpy(), cross)
        in_plane = np.zeros((3, 3, 3), dtype=bool)
        in_plane[1] = cross[0]
        regions, count = ndimage.label(constant_pixels, in_plane)
        self.regions = torch.from_numpy(regions.astype(np.int32)).to(descriptor.device)  # (B, H, W), 0: none
        self.sizes = torch.bincount(self.regions.flatten(), minlength=count + 1).double()
        self.runs = _find_runs(regions.reshape(len(regions), -1))

    def __call__(self, images: Tensor, index: Tensor) -> Tensor:
        """Images (A, 1, H, W) of the problems ``index`` (A,), with their regions made constant."""
        if len(self.sizes) == 1:
            return images
        levelled: Tensor = _Levelled.apply(images, index, self)  # type: ignore[no-untyped-call]
        return levelled

    def level(self, images: Tensor, index: Tensor) -> Tensor:
        """The same without a derivative; on a CPU the images may be changed in place."""
        if len(self.sizes) == 1:
            return images
        if images.device.type == "cpu" and native.available():
            images, (runs, ends) = images.contiguous(), self.runs
            double, pixels = images.dtype == torch.float64, images[0].numel()
            _level(double, len(images), pixels, index, runs, ends, len(self.sizes), self.sizes, images)
            return images
        regions = self.regions[index].unsqueeze(1).long()
        # in float64: the float32 sum over a large region would be off by more than the rounding of one gray value
        sums = torch.zeros_like(self.sizes).index_add(0, regions.flatten(), images.flatten().double())
        return torch.where(regions > 0, (sums / self.sizes.clamp(min=1)).to(images.dtype)[regions], images)


class _Levelled(torch.autograd.Function):
    """:meth:`FlatRegions.level` of a copy.  It is a projection, its own adjoint."""

    @staticmethod
    def forward(images: Tensor, index: Tensor, regions: FlatRegions) -> Tensor:
        return regions.level(images.detach().clone(memory_format=torch.contiguous_format), index)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        _, ctx.index, ctx.regions = inputs

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None, None]:
        return ctx.regions(grad_output, ctx.index), None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, *_: None) -> Tensor:
        levelled: Tensor = ctx.regions(tangent, ctx.index)
        return levelled


def _find_runs(regions: npt.NDArray[np.integer]) -> tuple[Tensor, Tensor]:
    """Runs of pixels of one region in a row, of regions (B, pixels), 0 for none.

    Returns (runs, 3): first pixel, end, region; and ends (B + 1,): image b has the runs ends[b] … ends[b + 1] - 1.
    """
    before = np.pad(regions, ((0, 0), (1, 0)))
    after = np.pad(regions, ((0, 0), (0, 1)))
    changes = before != after  # (B, pixels + 1)
    images, firsts = np.nonzero(changes[:, :-1] & (regions > 0))
    _, lasts = np.nonzero(changes[:, 1:] & (regions > 0))
    runs = np.stack([firsts, lasts + 1, regions[images, firsts]], axis=1)
    ends = np.searchsorted(images, np.arange(len(regions) + 1))
    return torch.from_numpy(runs), torch.from_numpy(ends)
