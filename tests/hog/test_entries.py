"""Histograms in the entries of descriptors, and cells side by side."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor

from nablahog.hog import FourBlockNorm, HOGSpec, hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.hog.entries import CellAlignment, cell_entries

from .zoo import NORMALIZERS, noise, sized

SIZE = (48, 40)
SPECS: dict[str, HOGSpec] = {
    **{name: sized(spec, 4) for name, spec in DEFAULT_SPECS.items()},
    "blocks": presets.vlfeat("dalaltriggs", cell_size=4),
    "skimage L1-sqrt": presets.skimage(pixels_per_cell=(4, 4), block_norm="L1-sqrt"),
    "opencv, no overlap": presets.opencv((40, 48), (8, 8), (8, 8), (4, 4)),
    **NORMALIZERS,
}


def cosine(a: Tensor, b: Tensor) -> Tensor:
    """Of two histograms of each cell, (B, bins, rows, cols)."""
    return torch.cosine_similarity(a, b, dim=1)


@pytest.mark.parametrize("name", SPECS)
def test_entries_point_where_the_votes_do(name: str) -> None:
    """The same bins of the same cells: clipped and scaled, so not equal, but close in direction."""
    spec = SPECS[name]
    image = noise(2, 1, *SIZE)
    entries = cell_entries(hog(image, spec), spec)
    votes = histograms(image, spec).reshape(2, spec.colours, spec.bins, *spec.cells(*SIZE)).mean(dim=1)
    margin = spec.normalizer.footprint(0).margin
    votes = votes[..., margin : votes.shape[-2] - margin, margin : votes.shape[-1] - margin]
    if spec.signed and isinstance(spec.normalizer, FourBlockNorm) and spec.normalizer.parts == ("undirected",):
        half = spec.bins // 2
        votes = (votes[:, :half] + votes[:, half:]).repeat(1, 2, 1, 1)
    assert entries.shape == votes.shape
    assert cosine(entries, votes).min() > 0.85


@pytest.mark.parametrize("name", SPECS)
def test_cells_side_by_side_and_back(name: str) -> None:
    spec = SPECS[name]
    cells = torch.rand(2, spec.bins, 12, 10, dtype=torch.float64)
    alignment = CellAlignment(spec, SIZE, cells)
    torch.testing.assert_close(alignment(alignment.restore(cells)), cells)
    assert alignment.restore(cells).shape[2:] == spec.cells(*SIZE)


def test_cells_side_by_side_count_every_vote_once() -> None:
    """A gradient that is the same everywhere gives each inner cell the votes of its pixels."""
    ramp = torch.linspace(0, 1, SIZE[1], dtype=torch.float64).expand(1, 1, *SIZE)
    for name in ("skimage", "opencv", "maskfeat"):
        spec = dataclasses.replace(SPECS[name], gamma="none")
        cells = histograms(ramp, spec).reshape(1, spec.colours, spec.bins, *spec.cells(*SIZE))[:, 0]
        result = CellAlignment(spec, SIZE, cells)(cells).sum(dim=1)[0, 2:-2, 2:-2]
        step = 2 * spec.value_range / (SIZE[1] - 1) * (4 if spec.mask == "sobel" else 1)
        torch.testing.assert_close(result, torch.full_like(result, 16 * step), rtol=0.02, atol=0)
