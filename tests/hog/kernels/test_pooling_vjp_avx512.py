"""Gradients of votes looked up in tables, beside the same read pixel by pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from nablahog.hog import presets
from nablahog.hog.kernels import loops
from nablahog.hog.kernels.pooling_vjp_avx512 import fits

from ..zoo import noise

PAPER = presets.paper()
SPECS = {
    "paper": PAPER,
    "uoctti": presets.uoctti(colour="gray"),
    "thirty-bins": replace(PAPER, bins=30),
    "large-cells": replace(PAPER, cell_size=(20, 24)),
    "small-cells": replace(PAPER, cell_size=(3, 2)),
    "hard": presets.dpm(),
}


@pytest.mark.skipif(not fits(4, 1), reason="the processor looks up fewer than sixteen numbers at a time")
@pytest.mark.parametrize("name", SPECS)
@pytest.mark.parametrize("size", [(128, 128), (49, 83), (17, 29), (61, 16)])
def test_tables_hold_what_is_read_without_them(name: str, size: tuple[int, int]) -> None:
    spec = SPECS[name]
    try:
        spec.grid(*size)
    except ValueError as why:
        pytest.skip(str(why))
    rows, cols = spec.cells(*size)
    images = noise(2, 3 if spec.colour == "largest" else 1, *size, dtype=torch.float32)
    grad_cells = noise(2, rows, cols, spec.bins, seed=1, dtype=torch.float32).flatten(1).numpy()
    operator = loops._operator(spec, images.shape[1:], images.dtype)
    assert operator.plan.pooling.look_up

    def gradient(look_up: bool) -> np.ndarray:
        plan = operator.plan._replace(pooling=operator.plan.pooling._replace(look_up=look_up))
        out = np.empty((2, images[0].numel()), np.float32)
        band = loops.new_band_vjp(plan, size[1], out.dtype)
        loops.cells_vjp_of_images(operator.pixels(images), plan, grad_cells, (0, 2), (0, size[0]), band, out)
        return out

    one, other = gradient(True), gradient(False)
    np.testing.assert_allclose(one, other, rtol=1e-4, atol=3e-6 * np.abs(other).max())


def test_tables_of_more_bins_than_they_hold_are_not_used() -> None:
    assert not fits(4, 31)
    assert not fits(8, 9)
    many = replace(PAPER, bins=36)
    assert not loops._operator(many, torch.Size((1, 64, 64)), torch.float32).plan.pooling.look_up
