"""Histograms from descriptors of every dialect, and in the bins of a prior's network."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.hog import BlockNorm, FourBlockNorm, HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.hog.steps import normalize_reference
from nablahog.invert import Search
from nablahog.invert.histograms import cells_in_bins, recover_histograms, searchable

from .photographs import photograph

SIZE = (48, 40)
FEW = Search(max_evaluations=20)
SPECS: dict[str, HOGSpec] = {
    "vlfeat": presets.vlfeat(cell_size=4),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs", cell_size=4),
    "dpm": presets.dpm(4),
    "dlib": presets.dlib(4),
    "piotr": presets.piotr(4),
    "cnn-hog": presets.cnn_hog(4),
    "seeing3d": presets.seeing3d(4),
    "aubry": presets.aubry(4),
    "skimage": presets.skimage(pixels_per_cell=(4, 4)),
    "skimage-sqrt": presets.skimage(pixels_per_cell=(4, 4), transform_sqrt=True, block_norm="L1-sqrt"),
    "opencv": presets.opencv((40, 48), (8, 8), (4, 4), (4, 4)),
    "opencv-signed": presets.opencv((40, 48), (8, 8), (4, 4), (4, 4), nbins=18, gamma=False, signed=True),
    "dalal-triggs": presets.dalal_triggs(4),
    "maskfeat": presets.maskfeat(4, gaussian_window=0),
}
# distances of what is recovered, where the descriptor does not determine the histograms
LEFT = {
    "dpm": 0.3,
    "dlib": 0.3,
    "seeing3d": 0.3,
    "opencv": 0.4,
    "opencv-signed": 0.4,
    "dalal-triggs": 0.2,
    "aubry": 0.15,
}


def scene(dtype: torch.dtype = torch.float32) -> Tensor:
    """(2, 1, H, W): a bright disc on a shaded ground, and a dark square."""
    y, x = torch.meshgrid(*(torch.linspace(-1, 1, n, dtype=dtype) for n in SIZE), indexing="ij")
    disc = torch.sigmoid(20 * (0.6 - torch.hypot(x, y))) * 0.6 + 0.15 * (x + 1) + 0.05
    square = 0.8 - 0.6 * torch.sigmoid(20 * (0.5 - torch.maximum((x - 0.2).abs(), y.abs()))) - 0.05 * y
    return torch.stack([disc, square])[:, None]


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


@pytest.mark.parametrize("name", SPECS)
def test_an_image_is_found_for_every_dialect(name: str) -> None:
    """Nearly of the descriptor, and like the scene, or its negative if unsigned."""
    spec, images = SPECS[name], scene()
    result = reconstruct(hog(images, spec), spec, SIZE, search=Search(max_evaluations=150))
    assert result.distance.min() < 0.4  # the other scene is shaded all over, which hard votes are hard to fit to
    assert result.distance.max() < 0.8
    difference = (hog(result.image, spec) - hog(images, spec)).flatten(1).norm(dim=1)
    torch.testing.assert_close(result.distance, difference / hog(images, spec).flatten(1).norm(dim=1))
    for image, original in zip(result.image, images, strict=True):
        alike = correlation(image, original)
        assert (alike if searchable(spec).signed else abs(alike)) > 0.5


@pytest.mark.parametrize("name", SPECS)
def test_recovered_histograms_normalise_to_the_descriptor(name: str) -> None:
    spec = searchable(SPECS[name])
    assert (spec.vote, spec.angle, spec.gamma) == ("linear", "exact", "none")
    image = torch.rand(1, 1, *SIZE, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    descriptor = hog(image, spec)
    result = recover_histograms(descriptor, spec, SIZE, max_evaluations=200)
    assert result.shape == histograms(image, spec).shape
    back = normalize_reference(result, spec).permute(0, 2, 3, 1)
    assert (back - descriptor).norm() < LEFT.get(name, 0.05) * descriptor.norm()


def test_the_printed_normaliser_is_inverted_exactly_and_others_up_to_contrast() -> None:
    image, spec = photograph(64).double(), presets.paper(8)
    torch.testing.assert_close(recover_histograms(hog(image, spec), spec), histograms(image, spec))
    for spec, left in ((presets.paper(8, global_form="robust"), 1e-6), (presets.uoctti(8), 0.2)):
        result, true = recover_histograms(hog(image, spec), spec), histograms(image, spec)
        true = true / true.sum()
        assert (result / result.sum() - true).norm() < left * true.norm()


def test_undirected_channels_are_unsigned_bins() -> None:
    spec, image = presets.aubry(4), torch.rand(1, 3, *SIZE, dtype=torch.float64)
    unsigned = searchable(spec)
    assert (unsigned.signed, unsigned.bins) == (False, 9)
    torch.testing.assert_close(hog(image, unsigned), hog(image, spec))


def test_directed_texture_alone_is_refused() -> None:
    spec = dataclasses.replace(presets.dpm(4), normalizer=FourBlockNorm(parts=("undirected", "texture"), texture="dpm"))
    with pytest.raises(ValueError, match="can be inverted only with its directed channels"):
        reconstruct(hog(scene(), spec), spec, SIZE)


def test_a_root_is_searched_and_squared() -> None:
    spec = dataclasses.replace(presets.uoctti(4), gamma="sqrt", value_range=255.0)
    root = dataclasses.replace(presets.uoctti(4), value_range=255.0**0.5)
    images, search = scene(), Search(max_evaluations=150)
    result = reconstruct(hog(images, spec), spec, SIZE, search=search)
    expected = reconstruct(hog(images.sqrt(), root), root, SIZE, search=search)
    assert (result.image - expected.image.square()).abs().mean() < 0.03


@pytest.mark.parametrize("name", ["uoctti", "skimage", "maskfeat"])
def test_each_colour_described_separately(name: str) -> None:
    s = dataclasses.replace({"uoctti": presets.uoctti(4), **SPECS}[name], colour="separate", layout="cells")
    descriptor = hog(torch.rand(2, 3, *SIZE, generator=torch.Generator().manual_seed(0)), s)
    assert reconstruct(descriptor, s, SIZE, search=FEW).image.isfinite().all()


@pytest.mark.parametrize("step", [(2, 2), (3, 3)])
def test_cells_in_no_block_are_unknown_not_flat(step: tuple[int, int]) -> None:
    s = dataclasses.replace(presets.skimage(pixels_per_cell=(8, 8)), normalizer=BlockNorm((2, 2), step))
    image = torch.rand(1, 1, 40, 40, generator=torch.Generator().manual_seed(0))
    result = reconstruct(hog(image, s), s, (40, 40), search=FEW)
    assert result.image.isfinite().all()
    assert result.image[..., 33:, 33:].unique().numel() > 20


def test_bins_of_a_network_conserve_votes_and_their_angle() -> None:
    """From twelve signed bins to eighteen: votes at an angle go to the nearest two, in proportion."""
    spec = dataclasses.replace(presets.uoctti(8), bins=12)
    votes = torch.zeros(1, 12, 2, 2, dtype=torch.float64)
    votes[:, 1] = 4.0  # at 30°, between the bins at 20° and 40°
    cells = cells_in_bins(votes, spec, (16, 16), 18, 0.0, 2 * math.pi)
    assert torch.nonzero(cells[0, :, 0, 0]).flatten().tolist() == [1, 2]
    torch.testing.assert_close(cells[0, 1:3, 0, 0], torch.full((2,), 2.0, dtype=torch.float64))
