"""The operator ∇HOG: the four steps of Section 2 in a row."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, overload

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from . import kernels
from .checks import check_choice
from .inputs import ArrayImage, image_batch, to_array
from .layout import to_layout
from .spec import HOGSpec
from .steps import histograms_reference, normalize_reference, spread_nan

Backend: TypeAlias = Literal["auto", "torch"]
ResultLayout: TypeAlias = Literal["cells", "native"]


def _check(images: Tensor, spec: HOGSpec, backend: Backend) -> None:
    if not isinstance(images, Tensor):
        raise TypeError(f"images must be a torch tensor (B, C, H, W), got {type(images).__name__}")
    if images.dim() != 4 or images.shape[1] < 1:
        raise ValueError(f"images must have shape (B, C, H, W) with at least one channel, got {tuple(images.shape)}")
    spec.check_channels(images.shape[1])
    if images.dtype not in (torch.uint8, torch.float32, torch.float64):
        raise TypeError(f"images must be float32 or float64 in 0…1, or uint8 in 0…255, got {images.dtype}")
    if backend != "auto":
        check_choice("backend", backend, Backend)


def histograms(images: Tensor, spec: HOGSpec, *, backend: Backend = "auto") -> Tensor:
    """Cell histograms before normalisation, Eq. 1-6: images as for :func:`hog` to (B, colours · bins, rows, cols).

    Entries are votes, gradient magnitudes in units of the spec's ``value_range``, 0 or more.
    """
    _check(images, spec, backend)
    if backend == "auto" and images.is_cpu and kernels.supports(spec):
        return kernels.histograms(images, spec)
    spec.grid(*images.shape[-2:])  # or it is too small; the loops check this with their cached parameters
    return histograms_reference(images, spec)


@overload
def hog(images: Tensor, spec: HOGSpec, *, layout: ResultLayout = "cells", backend: Backend = "auto") -> Tensor: ...
@overload
def hog(
    images: ArrayImage, spec: HOGSpec, *, layout: ResultLayout = "cells", backend: Backend = "auto"
) -> NDArray[Any]: ...
def hog(
    images: Tensor | ArrayImage, spec: HOGSpec, *, layout: ResultLayout = "cells", backend: Backend = "auto"
) -> Tensor | NDArray[Any]:
    """The HOG descriptor of a batch of images, exactly differentiable (Section 2 of the paper).

    Works on CPU and CUDA, under reverse and forward mode, ``vmap`` and ``torch.compile``; second derivatives exist away
    from kinks.  At kinks it returns the derivatives stated in ``docs/derivatives.md``, never NaN.  A pixel that is NaN
    or infinite, in any channel, makes its image's descriptor and gradient NaN, all of it; other images of the batch
    keep theirs.

    ``torch.export`` saves graphs with the operator in it; a process that loads one needs ``import
    nablahog.hog.kernels``, for ``import nablahog`` alone loads nothing that computes.

    Args:
        images: (B, C, H, W), float32 or float64 in 0…1, or uint8 in 0…255; any number of channels (three are R, G, B)
            and any strides: none is copied on a CPU.  Or a NumPy array (H, W), (H, W, C) or (B, H, W, C), C 1 or 3,
            or a PIL image of mode L or RGB.
        spec: the dialect, from :mod:`nablahog.presets`.
        layout: ``"cells"``, or ``"native"``, the shape and order that the library itself returns.
        backend: ``"auto"``, compiled loops on a CPU; ``"torch"``, the steps as the paper has them, a few operations of
            PyTorch each.  The results differ by rounding.

    Returns:
        (B, rows, cols, channels), or B in front of the library's own shape; the dtype of the images (the default dtype
        for uint8).  An array for arrays and PIL images, without B for a single one.

    Raises:
        TypeError: ``images`` is no tensor, array or PIL image, or of another dtype.
        ValueError: ``images`` has other axes, or is smaller than one cell.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> nablahog.hog(torch.rand(2, 3, 64, 48), spec).shape
    torch.Size([2, 8, 6, 31])
    >>> nablahog.hog(np.zeros((64, 48, 3), np.uint8), spec).shape  # an array: channels last, one image
    (8, 6, 31)
    >>> images = torch.rand(1, 1, 16, 16, requires_grad=True)
    >>> nablahog.hog(images, spec).square().sum().backward()
    >>> images.grad.shape
    torch.Size([1, 1, 16, 16])
    """
    if not isinstance(images, Tensor):
        batch, single = image_batch("images", images)
        return to_array(hog(batch, spec, layout=layout, backend=backend), single)
    _check(images, spec, backend)
    if backend == "auto" and images.is_cpu and kernels.supports(spec):
        descriptor = kernels.describe(images, spec)
    else:
        spec.grid(*images.shape[-2:])
        descriptor = normalize_reference(histograms_reference(images, spec), spec)  # Eq. 7
        descriptor = spread_nan(descriptor, images).permute(0, 2, 3, 1).contiguous()
    return descriptor if layout == "cells" else to_layout(descriptor, spec)


class HOG(nn.Module):
    """:func:`hog` with its spec, as a module to put into a network.  It has no parameters.

    >>> describe = nablahog.HOG(nablahog.presets.paper())
    >>> network = torch.nn.Sequential(torch.nn.Conv2d(3, 1, 3, padding=1), describe)
    >>> network(torch.rand(1, 3, 32, 32)).shape
    torch.Size([1, 4, 4, 9])
    """

    def __init__(self, spec: HOGSpec) -> None:
        super().__init__()
        self.spec = spec

    @overload
    def forward(self, images: Tensor) -> Tensor: ...
    @overload
    def forward(self, images: ArrayImage) -> NDArray[Any]: ...
    def forward(self, images: Tensor | ArrayImage) -> Tensor | NDArray[Any]:
        """Images (B, C, H, W) to descriptors (B, rows, cols, channels); see :func:`hog`."""
        return hog(images, self.spec)

    def extra_repr(self) -> str:
        return self.spec.name + f", cell_size={self.spec.cell_size}"
