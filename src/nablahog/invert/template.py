"""Pre-images of a linear detector's template: its weights become a descriptor that an image can have.

A template is not a descriptor.  Its weights have both signs, and their size is a cell's importance, not the strength
of its edges.  But an image whose histograms are the template's positive weights has edges where the detector scores
them, in the same directions, the stronger the more important they are; and that image has a descriptor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ..hog.dialects import as_spec
from ..hog.entries import CellAlignment, mean_over_colours, with_margin
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from ..inputs.arrays import Descriptors, as_descriptors, to_array
from ..inputs.numbers import as_seed, as_size, as_truth
from ..inputs.tensors import check_finite, check_floats
from ..runtime.pytorch import in_plain_mode
from .arguments import Objective, Search, check_axes
from .histograms import linear_vote_spec, set_nominal_contrast
from .preimage import reconstruct
from .reconstruction import Reconstruction, convert_like, relative_distance, scale_progress, to_unit_range

EMPHASIS = 2.0  # power of the weights: the few strong ones make the shape, the many weak ones are noise
TEMPLATE_SAMPLES = 6  # pre-images of an unsigned template, which are averaged
TEMPLATE_SMOOTHNESS = 0.3  # ξ: no image fits a template exactly, and with less the image would fit its noise


def template_descriptor(
    weights: Descriptors, spec: HOGSpec | str, image_size: tuple[int, int] | None = None, *, negative: bool = False
) -> Descriptors:
    """Descriptors of images whose histograms are the squares of templates' positive weights, or of the negative ones.

    The weights of a cell are averaged over the blocks that contain it, and over directed and undirected channels.
    Texture weights have no direction and are ignored.

    Args:
        weights: (B, rows, cols, channels), float32 or float64, of the detector's scores over descriptors; an array also
            (rows, cols, channels).
        spec: their dialect, or the name of a preset with its defaults.
        image_size: (height, width) of the images; by default whole cells.
        negative: whether to use the negative weights instead of the positive ones.

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
    dialect: HOGSpec = as_spec(spec)
    templates, is_single = as_descriptors("the weights", weights)
    check_floats("the weights", templates)
    check_axes("the weights", templates)
    whole_cells = dialect.image_size(*templates.shape[1:3])
    size: tuple[int, int] = whole_cells if image_size is None else as_size("image_size", image_size)
    expected = (*dialect.grid(*size), dialect.channels)
    if tuple(templates.shape[1:]) != expected:
        raise ValueError(
            f"a template for {dialect.name} descriptors of images of {size[0]}x{size[1]} pixels must have shape "
            f"{expected} (rows, cols, channels), got {tuple(templates.shape[1:])}"
        )
    check_finite("the weights", templates)
    bin_weights = dialect.normalizer.bin_weights(
        mean_over_colours(templates.permute(0, 3, 1, 2), dialect), dialect.bins, dialect.signed
    )
    negative = as_truth("negative", negative)
    histograms = (bin_weights * (-1 if negative else 1)).clamp(min=0) ** EMPHASIS
    if not histograms.flatten(1).any(dim=1).all():
        raise ValueError(f"a template has no {'negative' if negative else 'positive'} weights of edges")
    histograms = with_margin(histograms, dialect)  # cells that the descriptor leaves out have no weights
    alignment = CellAlignment(dialect, size, histograms)
    histograms = alignment.restore(alignment(histograms)).repeat(1, dialect.colours, 1, 1)
    descriptor = normalize_reference(set_nominal_contrast(histograms, dialect, size), dialect)
    descriptor = descriptor.permute(0, 2, 3, 1).contiguous()
    return descriptor if isinstance(weights, Tensor) else to_array(descriptor, is_single)


@in_plain_mode
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
    """Pre-images of templates, by :func:`template_descriptor`.

    No image fits a template exactly, so each search ends with grain of its own.  For unsigned dialects, whose searches
    draw no samples, several pre-images are averaged to remove it.  Learned priors are not used: they are trained on
    photographs, and make images of templates worse.

    Args:
        weights, spec, image_size, negative: as of :func:`template_descriptor`.
        seed: the seed of the first search; further searches take the next ones.
        max_evaluations: for each search; by default as for ``"best"``, or as for ``"fast"`` if there are several.
        progress: called with the evaluations done, and the most there can be.

    Returns:
        For an unsigned dialect, an image may be a negative.

    Raises:
        ValueError: as :func:`template_descriptor`.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> nablahog.invert.reconstruct_template(torch.randn(1, 4, 4, 31), spec).image.shape
    torch.Size([1, 1, 32, 32])
    """
    spec, seed = as_spec(spec), as_seed(seed)
    descriptor, _ = as_descriptors("the weights", template_descriptor(weights, spec, image_size, negative=negative))
    signed = linear_vote_spec(spec).signed
    count = 1 if signed else TEMPLATE_SAMPLES
    results = [
        reconstruct(
            descriptor,
            spec,
            image_size,
            quality="best" if signed else "fast",
            seed=seed + number,
            prior=None,
            search=Search(max_evaluations=max_evaluations),
            objective=Objective(smoothness=TEMPLATE_SMOOTHNESS),
            progress=scale_progress(progress, number, count),
        )
        for number in range(count)
    ]
    return convert_like(results[0] if signed else _average_results(results, descriptor, spec), weights)


def _average_results(results: Sequence[Reconstruction], descriptor: Tensor, spec: HOGSpec) -> Reconstruction:
    """The mean of pre-images of the same unsigned descriptors, where they may be negatives of each other."""
    images = torch.stack([result.image - result.image.mean(dim=(2, 3), keepdim=True) for result in results])
    correlations = (images * images[:1]).sum(dim=(2, 3, 4), keepdim=True)
    image = to_unit_range(torch.where(correlations < 0, -images, images).mean(dim=0), spec)
    return replace(
        results[0],
        image=image,
        distance=relative_distance(image, descriptor, spec),
        history=torch.cat([result.history for result in results]),
        evaluations=torch.stack([result.evaluations for result in results]).sum(dim=0),
        seconds=sum(result.seconds for result in results),
    )
