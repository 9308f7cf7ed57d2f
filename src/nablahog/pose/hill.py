"""Climbing to the pose of highest similarity, to a fraction of a degree.

Similarity is jagged below a degree: each sample that an edge passes moves the descriptor, so that even its true
derivative points the right way only in the mean.  Ascent along single derivatives gets stuck; what is fitted here to
many values and derivatives at once is the smooth hill under the jags.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ..render import PARAMETERS
from ..runtime.compile import compiled
from .search import UNITS
from .similarity import Similarity

_FIRST, _SECOND = np.triu_indices(len(PARAMETERS))  # the parameters of a quadratic's second-order coefficients
_COEFFICIENTS = 1 + len(PARAMETERS) + len(_FIRST)
_OF_VALUES = 8.0  # weight of a value against that of a derivative: jags are steep, but not high
_OF_SLOPES = 1 / np.square([0.94, 0.93, 0.64, 1.5, 1.15, 1.0])  # of derivatives: how far off each is, in UNITS
_STIFFNESS = 0.05  # of second derivatives towards 0, against one derivative each
_FLATTEST = 0.15  # of the steepest curvature: the least that is believed
_REACH = 2.0  # of the spread: how far from its samples the hill is believed


class Round(NamedTuple):
    """Renderings around a pose, before it is moved.

    Attributes:
        samples: their number, even.
        spread: root mean square of their parameters, in :data:`UNITS`.
        slopes: whether their derivatives count, too; without, they take two thirds of the time.
    """

    samples: int
    spread: float
    slopes: bool


HILL = (
    Round(4, 0.8, slopes=True),
    Round(4, 0.7, slopes=True),
    Round(4, 0.6, slopes=True),
    Round(12, 0.6, slopes=False),
    Round(12, 0.6, slopes=False),
)
"""Slopes show early how the hill is bent; what then counts is its top, of which values know more."""


def climb(similarity: Similarity, pose: Tensor, rounds: Sequence[Round], generator: torch.Generator) -> Tensor:
    """The top of the hill around ``pose`` (6,), to which a quadratic is fitted after each round of samples.

    Samples come in pairs on both sides of the pose, so that its own place and slope are fitted independently, and along
    directions at right angles, so that few of them say something about all.  Those of rounds before count the less the
    farther away they have turned out to be.
    """
    directions = _directions(sum(round_.samples for round_ in rounds) // 2, generator)
    poses, found = pose.new_empty(0, len(pose)), pose.new_empty(0, 1 + len(pose))
    for count, spread, slopes in rounds:
        unit = spread * UNITS
        some, directions = directions[: count // 2], directions[count // 2 :]
        sampled = pose + torch.cat([some, -some]) * unit
        poses, found = torch.cat([poses, sampled]), torch.cat([found, _seen(similarity, sampled, slopes)])
        offsets = (poses - pose) / unit
        beyond = (offsets.square().mean(1).sqrt() - 1).clamp(min=0)
        pose = pose + unit * _top(offsets, found[:, 0], found[:, 1:] * unit, torch.exp(-0.5 * beyond**2))
    return pose


def _seen(similarity: Similarity, poses: Tensor, slopes: bool) -> Tensor:
    """Values and derivatives (N, 7) at poses (N, 6), NaN for derivatives that are not asked for."""
    if slopes:
        values, derivatives = similarity.derivatives(poses)
        return torch.cat([values[:, None], derivatives], 1)
    return functional.pad(similarity.values(poses)[:, None], (0, len(PARAMETERS)), value=math.nan)


def _directions(count: int, generator: torch.Generator) -> Tensor:
    """Offsets (count, 6) of root mean square 1, six by six at right angles."""
    size = len(PARAMETERS)
    some = torch.randn((math.ceil(count / size), size, size), generator=generator, dtype=torch.float64)
    found: Tensor = math.sqrt(size) * torch.linalg.qr(some).Q.reshape(-1, size)[:count]
    return found


def _top(offsets: Tensor, values: Tensor, slopes: Tensor, weights: Tensor) -> Tensor:
    """Where c + bᵀu + ½ uᵀAu is highest, fitted to values (N,) and slopes (N, 6), NaN where none are known, at offsets
    u (N, 6), weighted (N,)."""
    parameters = len(PARAMETERS)
    stiff = np.full(_COEFFICIENTS, 1e-9)
    stiff[1 + parameters :] += _STIFFNESS
    normal, right = np.diag(stiff), np.zeros(_COEFFICIENTS)
    _normal_equations(*(part.numpy() for part in (offsets, values, slopes, weights)), _OF_SLOPES, normal, right)
    found = np.linalg.solve(normal, right)
    curvature = np.zeros((parameters, parameters))
    curvature[_FIRST, _SECOND] = curvature[_SECOND, _FIRST] = found[1 + parameters :]
    bends, axes = np.linalg.eigh(curvature)
    bends = np.minimum(bends, -_FLATTEST * max(np.abs(bends).max(), 1e-9))
    way = -axes @ ((axes.T @ found[1 : 1 + parameters]) / bends)
    return torch.from_numpy(way * (_REACH / max(float(np.linalg.norm(way)), _REACH)))


@compiled
def _normal_equations(u: Any, values: Any, slopes: Any, weights: Any, of_slopes: Any, normal: Any, right: Any) -> None:
    """Adds :func:`_top`'s least squares to ``normal`` (28, 28) and ``right`` (28,), of c, b, and A's upper half."""
    count, size = u.shape
    many, steep = 0, 0.0
    for n in range(count):
        if not np.isnan(slopes[n, 0]):
            many += size
            for k in range(size):
                steep += slopes[n, k] ** 2
    scale = max(np.sqrt(steep / max(many, 1)), 1e-12) if many else 1.0
    row = np.empty(right.size)
    which, factor = np.empty(size + 1, np.int64), np.empty(size + 1)
    for n in range(count):
        row[0] = 1
        at = 1 + size
        for i in range(size):
            row[1 + i] = u[n, i]
            for j in range(i, size):
                row[at] = u[n, i] * u[n, j] * (0.5 if i == j else 1.0)
                at += 1
        weight = _OF_VALUES * weights[n]
        for i in range(row.size):
            right[i] += weight * row[i] * values[n] / scale
            for j in range(row.size):
                normal[i, j] += weight * row[i] * row[j]
        if np.isnan(slopes[n, 0]):
            continue
        for k in range(size):  # b's k-th and A's k-th row times u
            which[0], factor[0] = 1 + k, 1
            for j in range(size):
                low, high = min(j, k), max(j, k)
                which[1 + j], factor[1 + j] = 1 + size + low * size - low * (low - 1) // 2 + high - low, u[n, j]
            weight = of_slopes[k] * weights[n]
            for i in range(1 + size):
                right[which[i]] += weight * factor[i] * slopes[n, k] / scale
                for j in range(1 + size):
                    normal[which[i], which[j]] += weight * factor[i] * factor[j]
