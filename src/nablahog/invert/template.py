"""What a linear detector looks for: from its weights to a descriptor that an image can have.

A template is no descriptor.  Its weights have both signs, and their size says how much a cell matters, not how strong
its edges are.  But an image whose histograms are a template's positive weights has edges where the detector wants them,
in the direction in which it wants them, the stronger the more they matter; and that image has a descriptor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ..hog.entries import CellAlignment, mean_over_colours, with_margin
from ..hog.inputs import Descriptors, descriptor_tensor, to_array
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from .checks import check_finite, descriptors_as_tensor
from .histograms import at_nominal_contrast, searchable
from .options import Objective, Search
from .preimage import reconstruct
from .reconstruction import Reconstruction, of_the_kind, relative_distance, to_unit_range

EMPHASIS = 2.0  # power of the weights: a few strong ones make the shape, and many weak ones only noise
SAMPLES = 6  # pre-images of an unsigned template, whose mean is shown
SMOOTHNESS = 0.3  # ξ: no image has a template, and less would only explain its noise


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


def reconstruct_template(
    weights: Descriptors,
    spec: HOGSpec | str,
    image_size: tuple[int, int] | None = None,
    *,
    negative: bool = False,
    seed: int = 0,
    max_evaluations: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Reconstruction[Descriptors]:
    """What templates look for: pre-images of :func:`template_descriptor`.

    No image has a template, so that each search ends with a grain of its own.  Of unsigned dialects, whose searches
    draw no samples, the mean of several pre-images is taken, which leaves it out.  No learned prior takes part: it
    knows photographs, and takes apart what the weights hold together.

    Args:
        weights, spec, image_size, negative: as of :func:`template_descriptor`.
        seed: of the first search; the others have the next ones.
        max_evaluations: of each search; by default those of the best quality, or, where there are several, of the fast.
        progress: called with the evaluations done, and the most there can be.

    Returns:
        Its distances are those of exactly its images; of an unsigned dialect these may as well be the negatives.

    Raises:
        ValueError: as :func:`template_descriptor`.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> nablahog.invert.reconstruct_template(torch.randn(1, 4, 4, 31), spec).image.shape
    torch.Size([1, 1, 32, 32])
    """
    spec = as_spec(spec)
    descriptor = descriptors_as_tensor(template_descriptor(weights, spec, image_size, negative=negative))
    signed = searchable(spec).signed
    count = 1 if signed else SAMPLES

    def share(number: int) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, most: progress(number * most + done, count * most)

    results = [
        reconstruct(
            descriptor,
            spec,
            image_size,
            quality="best" if signed else "fast",
            seed=seed + number,
            search=Search(max_evaluations=max_evaluations),
            objective=Objective(smoothness=SMOOTHNESS),
            progress=share(number),
        )
        for number in range(count)
    ]
    return of_the_kind(results[0] if signed else _mean(results, descriptor, spec), weights)


def _mean(results: Sequence[Reconstruction], descriptor: Tensor, spec: HOGSpec) -> Reconstruction:
    """The mean of pre-images of the same unsigned descriptors, some of which are negatives of others."""
    images = torch.stack([result.image - result.image.mean(dim=(2, 3), keepdim=True) for result in results])
    alike = (images * images[:1]).sum(dim=(2, 3, 4), keepdim=True)
    image = to_unit_range(torch.where(alike < 0, -images, images).mean(dim=0), spec)
    return Reconstruction(
        image,
        relative_distance(image, descriptor, spec),
        results[0].stop_reason,
        torch.cat([result.history for result in results]),
        torch.stack([result.evaluations for result in results]).sum(dim=0),
        sum(result.seconds for result in results),
    )
