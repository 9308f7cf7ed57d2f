"""The descriptor of the mirrored image, from the descriptor alone."""

from __future__ import annotations

from torch import Tensor

from ..hog.channels import mirrored_channels
from ..hog.orientation import vote_rule
from ..hog.spec import HOGSpec


def mirrored(descriptor: Tensor, spec: HOGSpec, width: int) -> Tensor | None:
    """What :func:`nablahog.hog` gives for the images flipped from left to right, up to rounding.

    None if no permutation of channels does that, if cells do not cover the width exactly, or with hard votes, whose
    ties go to the same bin in either image.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect.
        width: of the images.
    """
    order = mirrored_channels(spec)
    whole = spec.image_size(descriptor.shape[1], descriptor.shape[2])[1] == width
    if order is None or vote_rule(spec).hard or not spec.pooling.mirrors or not whole:
        return None
    return descriptor.flip(2)[..., list(order)]
