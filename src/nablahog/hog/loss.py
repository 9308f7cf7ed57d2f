"""A loss for training: how far the descriptors of images are from those of others."""

from __future__ import annotations

from typing import Literal, NoReturn, TypeAlias

import torch
from torch import Tensor, nn

from ..inputs.numbers import check_choice
from ..inputs.tensors import advise_on_tensor, check_dense, check_device
from ..runtime.advice import warn_caller
from .descriptor import HALVES, advise_on_images, check_images, describe
from .dialects import as_spec, refuse_settings
from .spec import HOGSpec
from .steps import normalize_reference, pooling_axes

Reduction: TypeAlias = Literal["mean", "sum", "none"]
TEXTURE_GRADIENT = 0.25  # mean magnitude in an even texture, in units of the value range
FULL_WEIGHT_SHARE = 0.25  # of an even texture's ‖φ‖²: a target with less counts less


class HOGLoss(nn.Module):
    """‖φ(x) - φ(y)‖² / max(‖φ(y)‖², s²) of images x and targets y, where φ is the HOG; a module without parameters.

    0 where the descriptors agree.  For an ordinary target, ‖φ(y)‖ ≥ s, it is the square of the distance that
    :func:`nablahog.reconstruct` lowers and reports, and 1 for an x without edges.  A target with less, such as a blank
    sky, counts less: s² is a quarter of ‖φ‖² of an even texture, in which all bins of all cells are alike and the
    gradients have a mean magnitude of a quarter of the range.  ``docs/loss.md`` says what each dialect is for.

    * It is at most 1 + M / s², M the largest ‖φ‖² that the normaliser allows: 5 for ``aubry`` and for entries of length
      1 (``skimage``, ``opencv``, ``dalal_triggs``, ``maskfeat``), 6 for ``uoctti``, ``vlfeat`` and ``piotr``, 6.3 for
      ``cnn_hog``; on 8x8 entries 6.1 for ``seeing3d`` and 7.3 for ``dpm`` and ``dlib``; 69 for ``paper``, whose
      descriptor grows with the contrast, if images are in 0…1.
    * From one target to another, √loss changes by at most (1 + √loss) ‖Δφ(y)‖ / s, so it tends to that of a flat target
      as φ(y) does.  A factor k of the target's contrast changes 1 + √loss by at most the factor k, unless the dialect
      takes roots of gray values.

    Args:
        spec: the dialect, or the name of a preset with its defaults.  A dialect of hard votes has a derivative by
            gradient magnitudes alone (``docs/derivatives.md``).
        reduction: over the batch: ``"mean"``, ``"sum"``, or ``"none"`` for one value an image.  As in PyTorch's losses
            the mean of an empty batch is NaN, its sum 0.

    Raises:
        ValueError: there is no such preset or reduction.

    >>> loss = nablahog.HOGLoss("uoctti")
    >>> images, targets = torch.rand(2, 3, 64, 48, requires_grad=True), torch.rand(2, 3, 64, 48)
    >>> loss(images, targets).backward()
    >>> float(loss(targets, targets))
    0.0
    """

    def __init__(
        self, spec: HOGSpec | str | None = None, *, reduction: Reduction = "mean", **settings: NoReturn
    ) -> None:
        super().__init__()
        refuse_settings("nablahog.HOGLoss", spec, settings)
        check_choice("reduction", reduction, Reduction)
        self.spec = as_spec(spec)
        self.reduction: Reduction = reduction
        self._votes = _texture_votes(self.spec)
        self._entry_energy = _texture_energy(self.spec, self._votes)

    def forward(self, input: Tensor, target: Tensor) -> Tensor:
        """Images and targets (B, C, H, W), as for :func:`hog`, to the loss: a number, or (B,) with ``"none"``.

        It is in float32, or float64 if one of the two is.  Differentiable in both; either may be uint8.

        Raises:
            TypeError, ValueError: they are not tensors of one shape on one device, or :func:`hog` does not take them.
        """
        pair = input, target
        shape, target_shape = (x.shape if isinstance(x, Tensor) else type(x).__name__ for x in pair)
        if shape != target_shape or isinstance(shape, str):
            write = advise_on_tensor("input", input) or advise_on_tensor("target", target)
            raise ValueError(
                f"input and target must be tensors (B, C, H, W) of one shape, got {shape} and {target_shape}{write}"
            )
        check_device("target", target, "input", input)
        values = [x.float() if x.dtype in HALVES else x for x in pair]
        for name, images in zip(("input", "target"), values, strict=True):
            check_dense(name, images)
            check_images(images, self.spec)
        about_input, about_target = ([*advise_on_images(images, self.spec)] for images in values)
        for advice in dict.fromkeys((*about_input, *about_target)):
            names = [name for name, about in (("input", about_input), ("target", about_target)) if advice in about]
            warn_caller(f"{' and '.join(names)}: {advice}")
        descriptors, expected = (describe(images, self.spec) for images in values)
        scale = torch.maximum(expected.square().sum((1, 2, 3)), self._full_weight_energy(expected))
        losses = (descriptors - expected).square().sum((1, 2, 3)) / scale
        return losses if self.reduction == "none" else getattr(losses, self.reduction)()

    def _full_weight_energy(self, descriptors: Tensor) -> Tensor:
        """s² of images with such descriptors."""
        entries = descriptors.shape[1] * descriptors.shape[2]
        if self.spec.normalizer.reach() is None:  # one factor for all: one cell stands for as many
            cells = descriptors.new_full((1, self.spec.colours * self.spec.bins, 1, 1), self._votes * entries**0.5)
            return FULL_WEIGHT_SHARE * normalize_reference(cells, self.spec).square().sum()
        return descriptors.new_full((), FULL_WEIGHT_SHARE * self._entry_energy * entries)

    def extra_repr(self) -> str:
        return f"{self.spec.name}, reduction={self.reduction!r}"


def _texture_votes(spec: HOGSpec) -> float:
    """The votes in each bin of a cell of an even texture, away from the border."""
    axes = pooling_axes(spec, *spec.image_size(5, 5), torch.empty(0, dtype=torch.float64, device="cpu"))
    rows, cols = (float(along.totals().median()) for along in axes)
    return TEXTURE_GRADIENT * spec.value_range * rows * cols / spec.bins


def _texture_energy(spec: HOGSpec, votes: float) -> float:
    """‖φ‖² of one entry of an even texture with these votes in each bin."""
    reach = spec.normalizer.reach() or 0
    rows, cols = (spec.normalizer.footprint(axis).cells(1) + 2 * reach for axis in (0, 1))
    shape = 1, spec.colours * spec.bins, rows, cols
    entries = normalize_reference(torch.full(shape, votes, dtype=torch.float64, device="cpu"), spec)
    return float(entries[0, :, entries.shape[2] // 2, entries.shape[3] // 2].square().sum())
