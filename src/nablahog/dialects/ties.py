"""How many votes of a photograph hang on a rule for ties."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..hog import HOGSpec
from ..hog.orientation import bin_angles, direction
from .describer import Describer

_SLACK = 1e-7  # bins; gradients of 8-bit values that are not between two bins are further from there
_EQUAL = 1e-9  # relative: roots of equal products are rounded


@dataclass(frozen=True)
class Ties:
    """Shares of the gradients that are not 0, of pixels that may vote.

    Attributes:
        gradients: how many there are: one a pixel, or of separate colours three.
        between_bins: those exactly between two bins, of hard votes, which go to one or the other by a rule; None if
            votes are linear, and no rule is needed.
        between_colours: those that are the largest in two channels, but not alike there, so that a rule says which one
            votes; None if the largest of several channels is not looked for.
        directions: of those between bins, in degrees, where multiples of 45° lie there: gradients of 8-bit values meet
            no others exactly.
    """

    gradients: int
    between_bins: float | None
    between_colours: float | None
    directions: tuple[float, ...]


def ties(describer: Describer, spec: HOGSpec) -> Ties:
    """The ties of a photograph in a dialect, in exact arithmetic."""
    spec = replace(spec, value_range=255.0)  # in which differences of 8-bit values are exact
    gx, gy = describer.gradient(spec, torch.float64)
    voting = (gx != 0) | (gy != 0)
    if spec.border == "ignore":
        voting[:, [0, -1]] = False
        voting[:, :, [0, -1]] = False
    number = int(voting.sum())

    def share(of: Tensor) -> float:
        return float((of & voting).sum()) / number if number else 0.0

    hard = spec.vote == "hard"
    return Ties(
        number,
        share(_between_bins(gx, gy, spec)) if hard else None,
        share(_between_colours(describer, spec)) if spec.colour == "largest" and describer.channels > 1 else None,
        _directions(spec) if hard else (),
    )


def _between_bins(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    turned = direction(gx, gy) / spec.period * spec.bins
    position = (-turned if spec.counterclockwise else turned) - spec.bin_offset
    return (position - position.floor() - 0.5).abs() < _SLACK


def _between_colours(describer: Describer, spec: HOGSpec) -> Tensor:
    """Whether several channels have the largest magnitude, and are not the same vector, or if unsigned opposite."""
    gx, gy = describer.gradient(replace(spec, colour="separate"), torch.float64)
    squared = gx * gx + gy * gy
    largest = squared >= squared.amax(dim=0) * (1 - _EQUAL)
    first = largest.to(torch.uint8).argmax(dim=0, keepdim=True)
    x, y = gx.gather(0, first), gy.gather(0, first)
    along, across = gx * x + gy * y, gx * y - gy * x
    alike = (across.abs() <= _EQUAL * squared) & ((along > 0) | (not spec.signed))
    return (largest & ~alike).any(dim=0, keepdim=True)


def _directions(spec: HOGSpec) -> tuple[float, ...]:
    period = math.degrees(spec.period)
    between = np.degrees(bin_angles(spec) + spec.period / spec.bins / 2).tolist()
    met = {round(angle) % period for angle in between if abs(angle - 45 * round(angle / 45)) < 1e-6}
    return tuple(sorted(met))
