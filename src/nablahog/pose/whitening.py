"""The background of exemplar LDA: what HOG templates are like anywhere in photographs, and how unlike that one is.

After Hariharan, Malik and Ramanan ("Discriminative decorrelation for clustering and classification"): the descriptor of
photographs is taken to be stationary, so that one mean and one covariance per offset between two cells give the mean μ
and the covariance Σ of templates of any size, Σ as a block-Toeplitz matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from ..hog.spec import HOGSpec
from ..io.learned_model import NUMBER, SPEC, TEXTS, LearnedModel, check_tensor, tensor

LARGEST = 1e6  # entry of a mean or covariance: those of descriptors are far below 1


@dataclass(frozen=True, eq=False, repr=False)
class Background(LearnedModel):
    """Mean and autocovariance of a stationary descriptor, learned by :func:`.background.learn_background`.

    Templates are (N, rows, cols, C), float32 or float64, on any device, with at most ``order`` + 1 rows and columns.
    What methods return has their dtype and device and is computed in float64; it is differentiable in them.

    Attributes:
        spec: the dialect, with C channels; not globally normalised.
        mean: (C,), float64.
        covariance: (order + 1, 2 · order + 1, C, C), float64: entry [dy, order + dx, a, b] is that of channel a of a
            cell with channel b of the cell dy rows below and dx columns to the right.
        images: the names of the images it was learned from.
        regularization: λ, added to the diagonal of Σ; a multiple of it if Σ + λ is not positive definite.

    Raises:
        ValueError: these contradict each other, hold NaN, Inf or what no descriptor has, or λ is not in 1e-9…1e6.
    """

    KIND = "background"
    NOUN = "background"
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "mean": tensor(np.float64),
        "covariance": tensor(np.float64),
        "images": TEXTS,
        "regularization": NUMBER,
    }
    COMPRESSED = True

    spec: HOGSpec
    mean: Tensor
    covariance: Tensor
    images: tuple[str, ...]
    regularization: float = 0.01
    _factors: dict[tuple[int, int], Tensor] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        check_spec(self.spec)
        channels, order = self.spec.channels, self.order
        shapes = {"mean": (channels,), "covariance": (order + 1, 2 * order + 1, channels, channels)}
        for name, shape in shapes.items():
            check_tensor(name, getattr(self, name), torch.float64, shape, -LARGEST, LARGEST)
        if not torch.allclose(self.covariance[0].flip(0).mT, self.covariance[0]):
            raise ValueError("the covariance of two cells must not depend on which of them comes first")
        if not 1e-9 <= self.regularization <= LARGEST:
            raise ValueError(f"regularization must lie in 1e-9…{LARGEST:g}, got {self.regularization!r}")

    @property
    def summary(self) -> str:
        cells = f"{self.order + 1}x{self.order + 1}"
        return f"{len(self.images)} images, {self.spec.channels} channels, templates of up to {cells} cells"

    @property
    def order(self) -> int:
        """The largest offset between cells, in either direction, that has a covariance."""
        return len(self.covariance) - 1

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, f"the {self.NOUN}")

    def template_mean(self, rows: int, cols: int) -> Tensor:
        """μ, (rows, cols, C), float64."""
        return self.mean.expand(rows, cols, -1)

    def template_covariance(self, rows: int, cols: int) -> Tensor:
        """Σ without λ, (rows · cols · C, rows · cols · C), float64, of flattened templates.

        Raises:
            ValueError: the template is empty, or larger than ``order`` + 1.
        """
        most = self.order + 1
        if not (1 <= rows <= most and 1 <= cols <= most):
            raise ValueError(f"a template must have 1…{most} rows and columns of cells here, got {rows}x{cols}")
        above = self.covariance[1:].flip(0, 1).mT  # the cell at -dy, -dx sees this one at dy, dx
        offsets = torch.cat([above, self.covariance])
        row, col = torch.arange(rows), torch.arange(cols)
        dy, dx = row - row[:, None] + self.order, col - col[:, None] + self.order
        blocks = offsets[dy[:, :, None, None], dx]  # (row, row', col, col', channel, channel')
        return blocks.permute(0, 2, 4, 1, 3, 5).reshape(2 * [rows * cols * self.spec.channels])

    def factor(self, rows: int, cols: int) -> Tensor:
        """L, lower triangular, with L·Lᵀ = Σ + λ; cached."""
        size = rows, cols
        if size not in self._factors:
            self._factors[size] = _cholesky(self.template_covariance(rows, cols), self.regularization)
        return self._factors[size]

    def decorrelate(self, templates: Tensor) -> Tensor:
        """L⁻¹(q − μ), (N, rows, cols, C): over the background, entries of unit variance that do not correlate."""
        centred, factor = self._centred(templates)
        return _templates(torch.linalg.solve_triangular(factor, centred, upper=False), templates)

    def whiten(self, templates: Tensor) -> Tensor:
        """Σ⁻¹(q − μ), (N, rows, cols, C): the weights that tell q from the background best, by linear discriminant."""
        centred, factor = self._centred(templates)
        return _templates(torch.cholesky_solve(centred, factor), templates)

    def discriminability(self, templates: Tensor) -> Tensor:
        """‖Σ^-½(q − μ)‖, (N,): how unlike the background a template is, in its standard deviations."""
        norms: Tensor = self.decorrelate(templates).flatten(1).norm(dim=1)
        return norms

    def deviation(self, weights: Tensor) -> Tensor:
        """√(wᵀΣw), (N,): the standard deviation of the score of weights (N, rows, cols, C) over the background."""
        flat = self._flat(weights)
        deviations: Tensor = (self._factor_for(weights).mT @ flat).norm(dim=0).to(weights)
        return deviations

    def _centred(self, templates: Tensor) -> tuple[Tensor, Tensor]:
        """q − μ as columns, and L."""
        mean = self.template_mean(*templates.shape[1:3]).reshape(-1, 1).to(templates.device)
        return self._flat(templates) - mean, self._factor_for(templates)

    def _flat(self, templates: Tensor) -> Tensor:
        if templates.dim() != 4 or templates.shape[3] != self.spec.channels or not templates.is_floating_point():
            raise ValueError(
                f"templates must be floating-point tensors (N, rows, cols, {self.spec.channels}), "
                f"got {templates.dtype} of shape {tuple(templates.shape)}"
            )
        return templates.flatten(1).double().T

    def _factor_for(self, templates: Tensor) -> Tensor:
        return self.factor(*templates.shape[1:3]).to(templates.device)


def check_spec(spec: HOGSpec) -> None:
    """Raises ValueError unless a cell's descriptor depends on its neighbourhood only."""
    if spec.normalizer.reach() is None:
        raise ValueError(
            f"there is a background of locally normalised descriptors only: one factor for a whole image, as in "
            f"{spec.name}, makes templates of different images no samples of one distribution"
        )


def _templates(columns: Tensor, like: Tensor) -> Tensor:
    return columns.T.reshape(like.shape).to(like.dtype)


def _cholesky(covariance: Tensor, regularization: float) -> Tensor:
    """Of ``covariance`` with ``regularization`` added to its diagonal as often as it takes."""
    eye = torch.eye(len(covariance), dtype=covariance.dtype)
    factor: Tensor
    factor, failed = torch.linalg.cholesky_ex(covariance + regularization * eye)
    times = 1
    while failed:
        if times == 1:  # as often as it must be, not to try in between
            times = math.floor(-float(torch.linalg.eigvalsh(covariance)[0]) / regularization)
        times = max(times, 1) + 1
        factor, failed = torch.linalg.cholesky_ex(covariance + times * regularization * eye)
    return factor
