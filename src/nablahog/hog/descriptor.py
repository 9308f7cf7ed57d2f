"""The operator ∇HOG: the four steps of Section 2 in a row, by native loops on a CPU, Triton on a GPU, or PyTorch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, NoReturn, TypeAlias, overload

import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.autograd import forward_ad

from ..inputs.arrays import WHITE, ArrayImage, advise_on_levels, as_images, to_array
from ..inputs.numbers import check_choice
from ..runtime.advice import warn_caller
from ..runtime.pytorch import load_forward_mode
from . import triton as gpu
from .dialects import as_spec, refuse_settings
from .engine import REFERENCE, Engine, apply, is_traced, run_jvp
from .kernels.loops import find_loops
from .kernels.tables import ImageTables
from .layout import to_layout
from .spec import COLOURS, HOGSpec
from .steps import histograms_reference, merge_colours, normalize_reference, separate_colours, spread_nan

Backend: TypeAlias = Literal["auto", "torch", "triton"]
ResultLayout: TypeAlias = Literal["cells", "native"]
HALVES = (torch.float16, torch.bfloat16)


@overload
def hog(
    images: Tensor, spec: HOGSpec | str, *, layout: ResultLayout = "cells", backend: Backend = "auto"
) -> Tensor: ...
@overload
def hog(
    images: ArrayImage, spec: HOGSpec | str, *, layout: ResultLayout = "cells", backend: Backend = "auto"
) -> NDArray[Any]: ...
def hog(
    images: Tensor | ArrayImage, spec: HOGSpec | str, *, layout: ResultLayout = "cells", backend: Backend = "auto"
) -> Tensor | NDArray[Any]:
    """The HOG descriptor of a batch of images, exactly differentiable (Section 2 of the paper).

    Works on CPU and CUDA, under reverse and forward mode, ``vmap`` and ``torch.compile``; second derivatives exist away
    from kinks.  At kinks it returns the derivatives stated in ``docs/derivatives.md``, never NaN.  A pixel that is NaN
    or infinite, in any channel, makes the whole descriptor and gradient of its image NaN; other images of the batch do
    not change.

    ``torch.export`` saves graphs that contain the operator; a process that loads one needs ``import
    nablahog.hog.operators``, because ``import nablahog`` alone does not load it.

    Args:
        images: (B, C, H, W), float32 or float64 in 0…1, or uint8 in 0…255; any number of channels (three are R, G, B)
            and any strides; nothing is copied on a CPU.  float16 and bfloat16 are computed in float32.  Or an array
            (H, W), (H, W, C) or (B, H, W, C), C 1 or 3, or a PIL image of any mode, which is described upright and over
            white.
        spec: the dialect, from :mod:`nablahog.presets`, or the name of a preset with its defaults, ``"skimage"``.
        layout: ``"cells"``, or ``"native"``, the shape and order that the library itself returns.
        backend: ``"auto"``, compiled loops on a CPU, Triton kernels on a GPU; ``"torch"``, the steps of the paper, each
            in a few operations of PyTorch; ``"triton"``, Triton kernels or an error.  The results differ by
            rounding.

    Returns:
        (B, rows, cols, channels), or B in front of the library's own shape; the dtype of the images (for uint8 the
        default dtype; under autocast float32 for float16 and bfloat16).  The gradient has the dtype of the images.  An
        array for arrays and PIL images, without B for a single one.  On the device ``meta`` only a shape.

    Raises:
        TypeError: ``images`` is not a tensor, array or PIL image, or has another dtype.
        ValueError: ``images`` has other axes, or is smaller than one cell; there is no such preset; the backend is
            ``"triton"``, and ``images`` are not on a GPU.
        ModuleNotFoundError: the backend is ``"triton"``, which is not installed.

    Warns:
        UserWarning: the floats are far beyond 0…1 (below -0.5 or above 2; some pixels are checked, on the CPU only);
            there are four channels; the spec is scikit-image's for gray images, and there are three; or, once, a GPU is
            used without Triton.

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
    spec = as_spec(spec)
    batch, is_single = as_images("images", images)
    is_half = batch.dtype in HALVES
    values = batch.float() if is_half and not (batch.is_cuda and _uses_triton(batch.device, backend)) else batch
    check_images(values, spec, backend)
    for advice in advise_on_images(values, spec):
        warn_caller(advice)
    descriptor = describe(values, spec, backend=backend)
    if layout != "cells":
        check_choice("layout", layout, ResultLayout)
        descriptor = to_layout(descriptor, spec)
    if is_half and not torch.is_autocast_enabled(batch.device.type):
        descriptor = descriptor.to(batch.dtype)
    return descriptor if batch is images else to_array(descriptor, is_single)


def check_images(images: Tensor, spec: HOGSpec, backend: Backend = "auto") -> None:
    """Raises TypeError or ValueError unless images (B, C, H, W) have a descriptor."""
    last = images.dim() in (3, 4) and images.shape[-3] > COLOURS + 1 and images.shape[-1] in (1, COLOURS)
    if last:  # their channels would be columns, too few for a cell
        last = spec.pooling.cells(images.shape[-1], spec.cell_size[1], 1, spec.partial_cells) < 1
    if images.dim() != 4 or images.shape[1] < 1 or last:
        advice = {2: "images[None, None]", 3: "images[None] for one image (C, H, W), images[:, None] for gray ones"}
        if last:
            advice = {3: "images.permute(2, 0, 1)[None]", 4: "images.permute(0, 3, 1, 2)"}
        write = f": write {advice[images.dim()]}" if images.dim() in advice else ""
        raise ValueError(
            f"images must have shape (B, C, H, W) with at least one channel, got {tuple(images.shape)}{write}"
        )
    channels = images.shape[1]
    if spec.colour == "separate":
        spec.check_channels(channels)
    if images.dtype not in (torch.uint8, torch.float32, torch.float64) and not (
        images.is_cuda and images.dtype in HALVES
    ):
        write = "" if images.is_complex() else WHITE
        raise TypeError(f"images must be floats in 0…1, or uint8 in 0…255, got {images.dtype}{write}")
    if backend != "auto":
        check_choice("backend", backend, Backend)


def advise_on_images(images: Tensor, spec: HOGSpec) -> Iterator[str]:
    """What to do with images (B, C, H, W) whose channels or levels are seldom meant; nothing while they are traced."""
    if is_traced(images):
        return
    channels = images.shape[1]
    if channels == COLOURS + 1:
        yield (
            "images have 4 channels, and each of them is described; of RGBA images drop the last, write images[:, :3], "
            "or pass a PIL image, which is put over white"
        )
    elif channels == COLOURS and makes_colours_gray(spec):
        yield (
            "images have 3 channels, which this spec makes gray (Eq. 1); scikit-image refuses them, or takes the "
            "channel of largest gradient: write presets.skimage(channel_axis=-1) for that"
        )
    advice = advise_on_levels(images)
    if advice:
        yield advice


def makes_colours_gray(spec: HOGSpec) -> bool:
    """Whether colour images become gray (Eq. 1) for a spec of scikit-image, which refuses them or uses the colours."""
    return spec.colour == "gray" and spec.layout in ("blocks", "block-vector")


class HOG(nn.Module):
    """:func:`hog` with its spec and layout, as a module to put into a network.  It has no parameters.

    >>> describe = nablahog.HOG(nablahog.presets.paper())
    >>> network = torch.nn.Sequential(torch.nn.Conv2d(3, 1, 3, padding=1), torch.nn.Sigmoid(), describe)
    >>> network(torch.rand(1, 3, 32, 32)).shape
    torch.Size([1, 4, 4, 9])
    """

    def __init__(
        self,
        spec: HOGSpec | str | None = None,
        *,
        layout: ResultLayout = "cells",
        backend: Backend = "auto",
        **settings: NoReturn,
    ) -> None:
        super().__init__()
        refuse_settings("nablahog.HOG", spec, settings)
        check_choice("layout", layout, ResultLayout)
        check_choice("backend", backend, Backend)
        self.spec = as_spec(spec)
        self.layout: ResultLayout = layout
        self.backend: Backend = backend

    @overload
    def forward(self, images: Tensor) -> Tensor: ...
    @overload
    def forward(self, images: ArrayImage) -> NDArray[Any]: ...
    def forward(self, images: Tensor | ArrayImage) -> Tensor | NDArray[Any]:
        """Images (B, C, H, W) to descriptors (B, rows, cols, channels); see :func:`hog`."""
        return hog(images, self.spec, layout=self.layout, backend=self.backend)

    def extra_repr(self) -> str:
        return self.spec.name + ("" if self.layout == "cells" else f", layout={self.layout!r}")


def _uses_triton(device: torch.device, backend: Backend) -> bool:
    """Whether Triton's kernels compute the descriptor.  Raises if ``backend`` asks for them and they cannot."""
    if backend == "triton":
        gpu.check(device)
    return backend == "triton" or (backend == "auto" and gpu.chosen(device))


def _choose_engine(x: Tensor, spec: HOGSpec, backend: Backend) -> Engine:
    if backend == "auto" and x.is_cpu:
        return find_loops(spec)
    if not _uses_triton(x.device, backend):
        return REFERENCE
    from .triton.steps import TRITON_ENGINE

    return TRITON_ENGINE


def histograms(images: Tensor, spec: HOGSpec, *, backend: Backend = "auto") -> Tensor:
    """Cell histograms before normalisation, Eq. 1-6: images as for :func:`hog` to (B, colours · bins, rows, cols).

    Entries are votes, gradient magnitudes in units of the spec's ``value_range``, 0 or more.  Images are not checked.
    """
    if spec.colour == "separate":
        return _join_colours(histograms(separate_colours(images), spec.single_colour, backend=backend), spec)
    step = _choose_engine(images, spec, backend).cells
    if step is None:
        spec.grid(*images.shape[-2:])  # raises if the image is too small, as the engines do with their cached tables
        return histograms_reference(images, spec)
    if is_traced(images):
        from .operators import cells as cells_operator  # PyTorch 2.10 cannot trace the import of a package

        spec.grid(*images.shape[2:])
        traced_cells: Tensor = cells_operator(images, spec.to_json())
        return traced_cells.permute(0, 3, 1, 2)
    return apply(step, images, spec).permute(0, 3, 1, 2)


def _join_colours(cells: Tensor, spec: HOGSpec) -> Tensor:
    """Histograms (B · colours, bins, rows, cols) to (B, colours · bins, rows, cols)."""
    return cells.reshape(-1, spec.colours * spec.bins, *cells.shape[2:])


def normalize(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser, Eq. 7: histograms (B, colours · bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    norm = _choose_engine(histograms, spec, "auto").norm
    if norm is None or is_traced(histograms):
        return normalize_reference(histograms, spec)
    cells = histograms.reshape(-1, spec.bins, *histograms.shape[2:]).permute(0, 2, 3, 1)
    descriptors = apply(norm, cells, spec.single_colour).permute(0, 3, 1, 2)
    return descriptors.reshape(-1, spec.channels, *descriptors.shape[2:])


def describe(images: Tensor, spec: HOGSpec, *, backend: Backend = "auto") -> Tensor:
    """Descriptors (B, rows, cols, channels) of images as :func:`hog` takes them, without its checks and warnings."""
    images = images.resolve_neg()  # PyTorch may store a negation as a flag, which the loops do not read
    if spec.colour == "separate":
        return merge_colours(describe(separate_colours(images), spec.single_colour, backend=backend), spec)
    step = _choose_engine(images, spec, backend).describe
    if step is not None:
        if not is_traced(images):
            return apply(step, images, spec)
        from .operators import describe as describe_operator

        spec.grid(*images.shape[2:])
        descriptors: Tensor = describe_operator(images, spec.to_json())
        return descriptors
    if images.is_meta:  # tensors without values, but with a graph
        shape = len(images), *spec.grid(*images.shape[-2:]), spec.channels
        dtype = images.dtype if images.is_floating_point() else torch.get_default_dtype()
        return images.to(dtype).sum((1, 2, 3)).reshape(-1, 1, 1, 1).expand(shape).contiguous()
    descriptor = normalize_reference(histograms(images, spec, backend=backend), spec)  # Eq. 7
    return spread_nan(descriptor, images).permute(0, 2, 3, 1).contiguous()


def byte_tables(spec: HOGSpec, shape: tuple[int, int, int]) -> ImageTables:
    """Constants of the native loops for images (C, H, W) of uint8, for other rooms' loops that include their headers.

    Raises:
        ValueError: the images are too small for a descriptor.
    """
    return ImageTables(spec, shape, torch.uint8)


def histograms_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, colours · bins, rows, cols) from those of the images (B, C, H, W)."""
    if spec.colour == "separate":
        images, tangents = separate_colours(images), separate_colours(tangents)
        return _join_colours(histograms_jvp(images, tangents, spec.single_colour), spec)
    step = find_loops(spec).cells if images.is_cpu else None
    if step is not None:
        return run_jvp(step, images.detach(), tangents, spec).permute(0, 3, 1, 2)
    load_forward_mode()
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(images.detach(), tangents)  # type: ignore[no-untyped-call]
        return forward_ad.unpack_dual(histograms_reference(dual, spec)).tangent  # type: ignore[no-any-return, no-untyped-call]
