"""The descriptor of the mirrored image, from the descriptor alone."""

from __future__ import annotations

from torch import Tensor

from ..hog.spec import FourBlockNorm, HOGSpec


def mirrored(descriptor: Tensor, spec: HOGSpec, width: int) -> Tensor | None:
    """What :func:`nablahog.hog` gives for the images flipped from left to right, up to rounding.

    An orientation θ becomes π - θ.  None if that is not a bin's for each bin, if cells do not cover the width exactly,
    or with hard votes, whose ties go to the same bin in either image.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect.
        width: of the images.
    """
    shift = 2 * spec.bin_offset
    half_turns = spec.bins / (2 if spec.signed else 1)  # bins of 180°
    target = half_turns - shift
    if spec.vote == "hard" or target != int(target) or descriptor.shape[2] * spec.cell_size[1] != width:
        return None
    channels = [(int(target) - k) % spec.bins for k in range(spec.bins)]
    if isinstance(spec.normalizer, FourBlockNorm):
        undirected = spec.bins // 2
        of_parts = {
            "directed": channels,
            "undirected": [(int(target) - k) % undirected for k in range(undirected)],
            "texture": [1, 0, 3, 2],  # left and right blocks
        }
        channels = []
        for part in spec.normalizer.parts:
            channels += [len(channels) + k for k in of_parts[part]]
    return descriptor.flip(2)[..., channels]
