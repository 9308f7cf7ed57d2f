"""The levels of an image that is shrunk: of scale s, with 1/s of its pixels, and cells with sides of 1/√s."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..hog.descriptor import hog
from ..hog.dialects import as_spec
from ..hog.spec import HOGSpec
from ..inputs.arrays import Descriptors, as_unit_range, to_array
from ..inputs.numbers import as_integers
from ..inputs.tensors import check_shape

SCALES = (64, 16, 4, 1)


def level_spec(spec: HOGSpec, scale: int, image_size: tuple[int, int]) -> tuple[HOGSpec, tuple[int, int]]:
    """The spec and (height, width) of a level; ValueError unless √s divides cell and image into whole pixels."""
    factor = math.isqrt(scale)
    if factor * factor != scale:
        raise ValueError(f"a scale must be a square number of at least 1, got {scale}")
    if any(n % factor for n in (*spec.cell_size, *image_size)):
        raise ValueError(
            f"an image of {image_size[0]}x{image_size[1]} pixels with cells of "
            f"{spec.cell_size[0]}x{spec.cell_size[1]} has no scale 1/{scale}: all sides must be multiples of {factor}"
        )
    cell = (spec.cell_size[0] // factor, spec.cell_size[1] // factor)
    return replace(spec, cell_size=cell), (image_size[0] // factor, image_size[1] // factor)


def scale_descriptors(image: Descriptors, spec: HOGSpec | str, scales: Sequence[int] = SCALES) -> list[Descriptors]:
    """The input of multi-scale-more: the descriptors (B, rows, cols, channels) of ``image`` at each scale.

    Args:
        image: (B, C, H, W) in 0…1 or uint8, or an array as for :func:`nablahog.hog`.  A pixel of a level
            is the mean of those it covers.
        spec: the dialect, or the name of a preset with its defaults.
        scales: as of :func:`.multiscale.reconstruct_multiscale`.

    Returns:
        One descriptor for each scale, in the order of ``scales``; differentiable by ``image``.  Arrays for arrays.

    Raises:
        TypeError: as :func:`nablahog.hog`.
        ValueError: a scale does not exist for this size; there is no such preset.

    >>> descriptors = nablahog.invert.scale_descriptors(torch.rand(1, 1, 64, 64), "paper", (16, 4, 1))
    >>> [tuple(level.shape) for level in descriptors]  # cells shrink with the image
    [(1, 8, 8, 9), (1, 8, 8, 9), (1, 8, 8, 9)]
    """
    spec, scales = as_spec(spec), as_integers("scales", scales)
    images, is_single = as_unit_range("image", image)
    check_shape("image", images, ("B", "C", "H", "W"))
    levels = [level_spec(spec, scale, (images.shape[2], images.shape[3]))[0] for scale in scales]
    descriptors = [hog(avg_pool2d(images, math.isqrt(s)), level) for s, level in zip(scales, levels, strict=True)]
    return [level if isinstance(image, Tensor) else to_array(level, is_single) for level in descriptors]
