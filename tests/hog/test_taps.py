"""Poolings in pieces: the same sums as in one, and tables that grow with the sides of an image, not with its area."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import steps
from nablahog.hog.kernels.tables import ImageTables
from nablahog.hog.steps import histograms_reference, pooling_axes

from .zoo import SPECS, noise, waves

CPU = torch.device("cpu")


def gradients(images: Tensor, name: str) -> tuple[Tensor, Tensor, Tensor]:
    """Histograms, a gradient, and a gradient of that."""
    images = images.clone().requires_grad_()
    histograms = histograms_reference(images, SPECS[name])
    (first,) = torch.autograd.grad((histograms * waves(histograms)).sin().sum(), images, create_graph=True)
    (second,) = torch.autograd.grad(first.square().sum(), images)
    return histograms.detach(), first.detach(), second


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECS)
def test_pieces_change_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    images = noise(2, 3, 31, 29)
    whole = gradients(images, name)
    for pixels in (5, 16):
        monkeypatch.setattr(steps, "PIECE", pixels)
        assert len(pooling_axes(SPECS[name], 31, 29, images)[0].pieces) > 1
        for got, expected in zip(gradients(images, name), whole, strict=True):
            assert_close(got, expected, rtol=0, atol=1e-12 * float(expected.abs().max()))
        mapped = torch.func.vmap(lambda image: histograms_reference(image[None], SPECS[name])[0])(images)
        assert_close(mapped, whole[0], rtol=0, atol=1e-12 * float(whole[0].abs().max()))


def _bytes(tables: Any) -> int:
    """Of all arrays and tensors in tables."""
    if isinstance(tables, Tensor | np.ndarray):
        return tables.nbytes
    return sum(map(_bytes, tables)) if isinstance(tables, tuple | list) else 0


@pytest.mark.parametrize("name", SPECS)
def test_tables_are_proportional_to_the_sides(name: str) -> None:
    """Of the compiled loops, of Triton's kernels, and of the plain steps."""
    s = SPECS[name]
    channels = 3 if s.colour == "separate" else 1
    triton = pytest.importorskip("nablahog.hog.triton.parameters")

    def sizes(side: int) -> list[int]:
        shape = torch.Size((channels, side, side))
        return [
            _bytes(ImageTables(s, (channels, side, side), torch.float32)._alive),
            _bytes(triton.make_tables(s, shape, torch.float32, torch.float32, CPU)),
            _bytes(pooling_axes(s, side, side, torch.empty(0))),
        ]

    for small, large in zip(sizes(512), sizes(1024), strict=True):
        assert large < 2.1 * small
