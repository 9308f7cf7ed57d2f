"""What a linear detector looks for: from its weights to a descriptor that an image can have.

A template is no descriptor.  Its weights have both signs, and their size says how much a cell matters, not how strong
its edges are.  But an image whose histograms are a template's positive weights has edges where the detector wants them,
in the direction in which it wants them, the stronger the more they matter; and that image has a descriptor.
"""

from __future__ import annotations

from torch import Tensor

from ..hog.entries import CellAlignment, mean_over_colours, with_margin
from ..hog.inputs import Descriptors, descriptor_tensor, to_array
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from .checks import check_finite
from .histograms import at_nominal_contrast

EMPHASIS = 2.0  # power of the weights: a few strong ones make the shape, and many weak ones only noise


def template_descriptor(
    weights: Descriptors, spec: HOGSpec | str, image_size: tuple[int, int] | None = None, *, negative: bool = False
) -> Descriptors:
    """Descriptors of images whose histograms are the squares of templates' positive weights, or negative ones.

    The weights of a cell are its means over the blocks that it is part of, and over directed and undirected channels.
    Weights of texture say nothing of edges, and are left out.

    Args:
        weights: (B, rows, cols, channels), float32 or float64, of the detector's scores over descriptors; an array also
            (rows, cols, channels).
        spec: their dialect, or the name of a preset with its defaults.
        image_size: (height, width) of the images; by default whole cells.
        negative: whether negative weights count, not positive ones.

    Returns:
        (B, rows, cols, channels), to be inverted by :func:`nablahog.reconstruct` with the same spec and image size.

    Raises:
        ValueError: the weights have another shape, are not finite, or none has the sign; there is no such preset.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> weights = torch.randn(1, 4, 4, 31)  # of a linear detector
    >>> descriptor = nablahog.template_descriptor(weights, spec)
    >>> nablahog.reconstruct(descriptor, spec, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    """
    spec = as_spec(spec)
    if not isinstance(weights, Tensor):
        tensor = descriptor_tensor("the template", weights)
        single = tensor.dim() == 3
        return to_array(_template_descriptor(tensor[None] if single else tensor, spec, image_size, negative), single)
    return _template_descriptor(weights, spec, image_size, negative)


def _template_descriptor(weights: Tensor, spec: HOGSpec, image_size: tuple[int, int] | None, negative: bool) -> Tensor:
    size = image_size or spec.image_size(*weights.shape[1:3])
    expected = (*spec.grid(*size), spec.channels)
    if tuple(weights.shape[1:]) != expected:
        raise ValueError(
            f"a template for {spec.name} descriptors of images of {size[0]}x{size[1]} pixels must have shape "
            f"{expected} (rows, cols, channels), got {tuple(weights.shape[1:])}"
        )
    check_finite("the weights", weights)
    of_bins = spec.normalizer.bin_weights(mean_over_colours(weights.permute(0, 3, 1, 2), spec), spec.bins, spec.signed)
    histograms = (of_bins * (-1 if negative else 1)).clamp(min=0) ** EMPHASIS
    if not histograms.flatten(1).any(dim=1).all():
        raise ValueError(f"a template has no {'negative' if negative else 'positive'} weights of edges")
    histograms = with_margin(histograms, spec)  # the cells that are left out have no weights
    alignment = CellAlignment(spec, size, histograms)
    histograms = alignment.restore(alignment(histograms)).repeat(1, spec.colours, 1, 1)
    descriptor = normalize_reference(at_nominal_contrast(histograms, spec, size), spec)
    return descriptor.permute(0, 2, 3, 1).contiguous()
