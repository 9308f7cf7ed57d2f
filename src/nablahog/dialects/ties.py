"""Ties on a photograph: gradients between two bins or two colour channels, where libraries differ by their rules."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..hog import HOGSpec
from ..hog.orientation import bin_angles, direction
from .describer import Describer

_SLACK = 1e-7  # bins; other gradients of 8-bit values are further from a boundary
_EQUAL = 1e-9  # relative rounding error of equal products


@dataclass(frozen=True)
class Ties:
    """Ties as shares of the gradients that are not 0, of pixels that vote.

    Attributes:
        gradients: their number: one a pixel, or three for separate colours.
        between_bins: share of those exactly between two bins, of hard votes; None for linear votes, which have no ties.
        between_colours: share of those with different gradients of the largest magnitude in two channels; None if the
            dialect does not take the largest channel.
        directions: multiples of 45°, in degrees, that lie between two bins; gradients of 8-bit values meet no other
            boundaries exactly.
    """

    gradients: int
    between_bins: float | None
    between_colours: float | None
    directions: tuple[float, ...]


def ties(describer: Describer, spec: HOGSpec) -> Ties:
    """Counts the ties of a photograph in a dialect, in exact arithmetic."""
    spec = replace(spec, value_range=255.0)  # differences of 8-bit values are exact
    gx, gy = describer.gradient(spec, torch.float64)
    voting = (gx != 0) | (gy != 0)
    if spec.border == "ignore":
        voting[:, [0, -1]] = False
        voting[:, :, [0, -1]] = False
    number = int(voting.sum())

    def share(tied: Tensor) -> float:
        return float((tied & voting).sum()) / number if number else 0.0

    hard = spec.vote == "hard"
    return Ties(
        number,
        share(_between_bins(gx, gy, spec)) if hard else None,
        share(_between_colours(describer, spec)) if spec.colour == "largest" and describer.channels > 1 else None,
        _directions(spec) if hard else (),
    )


def _between_bins(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    bins = direction(gx, gy) / spec.period * spec.bins
    position = (-bins if spec.counterclockwise else bins) - spec.bin_offset
    return (position - position.floor() - 0.5).abs() < _SLACK


def _between_colours(describer: Describer, spec: HOGSpec) -> Tensor:
    """Whether several channels have the largest magnitude with different gradients (opposite ones, if unsigned, are
    equal)."""
    gx, gy = describer.gradient(replace(spec, colour="separate", layout="cells"), torch.float64)
    squared = gx * gx + gy * gy
    largest = squared >= squared.amax(dim=0) * (1 - _EQUAL)
    first = largest.to(torch.uint8).argmax(dim=0, keepdim=True)
    x, y = gx.gather(0, first), gy.gather(0, first)
    along, across = gx * x + gy * y, gx * y - gy * x
    equal = (across.abs() <= _EQUAL * squared) & ((along > 0) | (not spec.signed))
    return (largest & ~equal).any(dim=0, keepdim=True)


def _directions(spec: HOGSpec) -> tuple[float, ...]:
    period = math.degrees(spec.period)
    between = np.degrees(bin_angles(spec) + spec.period / spec.bins / 2).tolist()
    return tuple(sorted({round(angle) % period for angle in between if abs(angle - 45 * round(angle / 45)) < 1e-6}))
