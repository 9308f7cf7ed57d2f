"""Histograms from descriptors of every dialect, in the bins of a network, and where the search begins."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import hog, presets, reconstruct
from nablahog.hog import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm, HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.hog.gradient import gradient
from nablahog.hog.normalizers.four_block import Outside, Texture
from nablahog.hog.steps import normalize_reference
from nablahog.invert import Search
from nablahog.invert.histograms import (
    _solve_levels,
    histograms_without_clip,
    linear_vote_spec,
    normalization_error,
    rebin_cells,
    recover_histograms,
)
from nablahog.invert.reconstruction import to_unit_range
from nablahog.invert.starts import (
    START_NOISE,
    integrate,
    match_contrast,
    mean_gradient,
    noise,
    pair_noise,
    start_near,
    starting_images,
)

from ..hog.zoo import NORMALIZERS, sized
from .photographs import correlation, photograph

SIZE = (48, 40)
FEW = Search(max_evaluations=20)
SPECS: dict[str, HOGSpec] = {
    **{name: sized(spec, 4) for name, spec in DEFAULT_SPECS.items()},
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs", cell_size=4),
    "skimage-sqrt": presets.skimage(pixels_per_cell=(4, 4), transform_sqrt=True, block_norm="L1-sqrt"),
    "opencv-signed": presets.opencv((40, 48), (8, 8), (4, 4), (4, 4), nbins=18, gamma=False, signed=True),
    **NORMALIZERS,
}


def lost(spec: HOGSpec) -> float:
    """How far the descriptor of what is recovered may be from the given one: not all determine the histograms."""
    norm = spec.normalizer
    if isinstance(norm, BlockNorm) and spec.pooling.has_blocks:
        return 0.2 if norm.epsilon <= 1 else 0.4  # a large ε hides the level of faint blocks
    if isinstance(norm, FourBlockNorm):
        return 0.3 if norm.outside == "drop" else 0.15 if norm.parts == ("undirected",) else 0.05
    return 0.05 if isinstance(norm, GlobalNorm | BlockNorm | CellNorm) else 0.2


def scene(dtype: torch.dtype = torch.float32) -> Tensor:
    """(2, 1, H, W): a bright disc on a shaded ground, and a dark square."""
    y, x = torch.meshgrid(*(torch.linspace(-1, 1, n, dtype=dtype) for n in SIZE), indexing="ij")
    disc = torch.sigmoid(20 * (0.6 - torch.hypot(x, y))) * 0.6 + 0.15 * (x + 1) + 0.05
    square = 0.8 - 0.6 * torch.sigmoid(20 * (0.5 - torch.maximum((x - 0.2).abs(), y.abs()))) - 0.05 * y
    return torch.stack([disc, square])[:, None]


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECS)
def test_an_image_is_found_for_every_dialect(name: str) -> None:
    """Nearly of the descriptor, and like the scene, or its negative if unsigned."""
    spec, images = SPECS[name], scene()
    result = reconstruct(hog(images, spec), spec, SIZE, search=Search(max_evaluations=150), prior=None)
    assert result.distance.min() < 0.4  # the other scene is shaded all over, which hard votes are hard to fit to
    assert result.distance.max() < 0.8
    difference = (hog(result.image, spec) - hog(images, spec)).flatten(1).norm(dim=1)
    torch.testing.assert_close(result.distance, difference / hog(images, spec).flatten(1).norm(dim=1))
    for image, original in zip(result.image, images, strict=True):
        alike = correlation(image, original)
        assert (alike if linear_vote_spec(spec).signed else abs(alike)) > 0.5


@pytest.mark.parametrize("name", SPECS)
def test_recovered_histograms_normalise_to_the_descriptor(name: str) -> None:
    spec = linear_vote_spec(SPECS[name])
    assert (spec.vote, spec.angle, spec.gamma) == ("linear", "exact", "none")
    image = torch.rand(1, 1, *SIZE, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    descriptor = hog(image, spec)
    result = recover_histograms(descriptor, spec, SIZE, max_evaluations=200)
    assert result.shape == histograms(image, spec).shape
    back = normalize_reference(result, spec).permute(0, 2, 3, 1)
    assert (back - descriptor).norm() < lost(spec) * descriptor.norm()


def test_the_printed_normaliser_is_inverted_exactly_and_others_up_to_contrast() -> None:
    image, spec = photograph(64).double(), presets.paper(8)
    for printed in (spec, dataclasses.replace(spec, normalizer=GlobalNorm(epsilon=100.0))):
        torch.testing.assert_close(recover_histograms(hog(image, printed), printed), histograms(image, printed))
    for spec, left in ((presets.paper(8, global_form="robust"), 1e-6), (presets.uoctti(8), 0.2)):
        result, true = recover_histograms(hog(image, spec), spec), histograms(image, spec)
        true = true / true.sum()
        assert (result / result.sum() - true).norm() < left * true.norm()


@pytest.mark.parametrize(("texture", "outside"), [("vlfeat", "repeat"), ("vlfeat", "missing"), ("dpm", "drop")])
def test_without_the_clip_texture_gives_histograms_in_closed_form(texture: Texture, outside: Outside) -> None:
    whole = FourBlockNorm(epsilon=1e-12, clip=1.0, texture=texture, outside=outside)
    spec = dataclasses.replace(presets.uoctti(8), normalizer=whole)
    images = torch.cat([photograph(128, name) for name in ("camera", "coffee")]).double()
    found, true = histograms_without_clip(hog(images, spec), spec), histograms(images, spec)
    assert found is not None
    if outside == "drop":
        true = true[..., 1:-1, 1:-1]
    for one, other in zip(found, true, strict=True):  # each up to a factor of its own
        large = other > 1e-2 * other.amax(dim=0)
        assert (one[large].log() - other[large].log()).std() < 1e-3
    alone = histograms_without_clip(hog(images[1:], spec), spec)
    torch.testing.assert_close(alone, found[1:])


def test_levels_are_as_far_apart_as_ratios() -> None:
    generator = torch.Generator().manual_seed(0)
    ratios = torch.randn(1, 4, 6, 7, generator=generator, dtype=torch.float64)
    known = (torch.rand(1, 4, 6, 7, generator=generator) < 0.8).double()
    levels = _solve_levels(ratios, known)
    for factor in (1e-6, 1e3):
        assert_close(_solve_levels(factor * ratios, known), factor * levels, rtol=1e-6, atol=0)


def test_levels_converge_far_from_each_other() -> None:
    """64 x 64 cells: the sky's level and the ground's are many cells apart."""
    image, spec = photograph(256, "rocket"), presets.uoctti(4)
    result, true = (h.sum(dim=1) for h in (recover_histograms(hog(image, spec), spec), histograms(image, spec)))
    apart = (result.log() - true.log())[true > 0.01 * true.mean()]
    assert apart.std() < 0.1


def test_clipped_cells_do_not_run_away() -> None:
    image = photograph(256)
    assert float(normalization_error(hog(image, "aubry"), presets.aubry(), (256, 256))) < 0.25


def test_flat_images_have_finite_histograms() -> None:
    assert torch.isfinite(recover_histograms(torch.zeros(1, 4, 4, 31), presets.uoctti(8))).all()


def test_undirected_channels_are_unsigned_bins() -> None:
    spec, image = presets.aubry(4), torch.rand(1, 3, *SIZE, dtype=torch.float64)
    unsigned = linear_vote_spec(spec)
    assert (unsigned.signed, unsigned.bins) == (False, 9)
    torch.testing.assert_close(hog(image, unsigned), hog(image, spec))


def test_directed_texture_alone_is_refused() -> None:
    spec = dataclasses.replace(presets.dpm(4), normalizer=FourBlockNorm(parts=("undirected", "texture"), texture="dpm"))
    with pytest.raises(ValueError, match="can be inverted only with its directed channels"):
        reconstruct(hog(scene(), spec), spec, SIZE, prior=None)


@pytest.mark.slow
def test_a_root_is_searched_and_squared() -> None:
    spec = dataclasses.replace(presets.uoctti(4), gamma="sqrt", value_range=255.0)
    root = dataclasses.replace(presets.uoctti(4), value_range=255.0**0.5)
    images, search = scene(), Search(max_evaluations=150)
    result = reconstruct(hog(images, spec), spec, SIZE, search=search, prior=None)
    expected = reconstruct(hog(images.sqrt(), root), root, SIZE, search=search, prior=None)
    assert (result.image - expected.image.square()).abs().mean() < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uoctti", "skimage", "maskfeat"])
def test_each_colour_described_separately(name: str) -> None:
    s = dataclasses.replace({"uoctti": presets.uoctti(4), **SPECS}[name], colour="separate", layout="cells")
    descriptor = hog(torch.rand(2, 3, *SIZE, generator=torch.Generator().manual_seed(0)), s)
    assert reconstruct(descriptor, s, SIZE, search=FEW, prior=None).image.isfinite().all()


@pytest.mark.parametrize("step", [(2, 2), (3, 3)])
def test_cells_in_no_block_are_unknown_not_flat(step: tuple[int, int]) -> None:
    s = dataclasses.replace(presets.skimage(pixels_per_cell=(8, 8)), normalizer=BlockNorm((2, 2), step))
    image = torch.rand(1, 1, 40, 40, generator=torch.Generator().manual_seed(0))
    result = reconstruct(hog(image, s), s, (40, 40), search=FEW, prior=None)
    assert result.image.isfinite().all()
    assert result.image[..., 33:, 33:].unique().numel() > 20


def test_bins_of_a_network_conserve_votes_and_their_angle() -> None:
    """From twelve signed bins to eighteen: votes at an angle go to the nearest two, in proportion."""
    spec = dataclasses.replace(presets.uoctti(8), bins=12)
    votes = torch.zeros(1, 12, 2, 2, dtype=torch.float64)
    votes[:, 1] = 4.0  # at 30°, between the bins at 20° and 40°
    cells = rebin_cells(votes, spec, (16, 16), 18, 0.0, 2 * math.pi)
    assert torch.nonzero(cells[0, :, 0, 0]).flatten().tolist() == [1, 2]
    torch.testing.assert_close(cells[0, 1:3, 0, 0], torch.full((2,), 2.0, dtype=torch.float64))


# --- where the search begins: integrated votes, noise, and their contrast

LIKE = torch.zeros(1, dtype=torch.float64)
BOTH = pytest.mark.parametrize("spec", [presets.uoctti(8), presets.paper(8)], ids=["signed", "unsigned"])


def test_mean_gradient_of_a_ramp_is_its_slope() -> None:
    spec = presets.uoctti(8)
    ramp = (torch.arange(64.0).expand(64, 64) / 255)[None, None]
    gx, gy = mean_gradient(histograms(ramp, spec), spec, 64, 64)
    # the ring of silent pixels is missing at the border; inside it is exact
    torch.testing.assert_close(gx[0, 16:-16, 16:-16], torch.full((32, 32), 2.0))
    assert gy.abs().max() < 1e-4


def test_integration_inverts_the_gradient_of_a_smooth_image() -> None:
    y, x = torch.meshgrid(torch.linspace(0, 3, 48), torch.linspace(0, 4, 64), indexing="ij")
    image = (torch.sin(x) * torch.cos(y)).double()[None, None]
    gx, gy = gradient(image, presets.paper(border="replicate"))
    gx[..., [0, -1]] *= 2  # one-sided differences span one pixel, not two
    gy[..., [0, -1], :] *= 2
    torch.testing.assert_close(integrate(gx, gy), image - image.mean(), atol=2e-3, rtol=0)


def test_starting_images_look_like_the_photograph_up_to_the_sign_if_unsigned() -> None:
    image, signed, unsigned = photograph(64), presets.uoctti(8), presets.paper(8)
    assert correlation(starting_images(histograms(image, signed), signed, 64, 64, 1, seed=0), image) > 0.8
    start = starting_images(histograms(image, unsigned), unsigned, 64, 64, 1, seed=0)
    assert abs(correlation(start, image)) > 0.6


@BOTH
def test_starting_images_differ_by_seed_and_number_but_not_by_batch(spec: HOGSpec) -> None:
    votes = histograms(torch.cat([photograph(64), photograph(64, "coins")]).double(), spec)
    start = starting_images(votes, spec, 64, 64, 3, seed=0)
    assert start.mean().item() == pytest.approx(0.5, abs=0.01)
    assert not torch.equal(start[:, 0], start[:, 1])
    assert not torch.equal(start, starting_images(votes, spec, 64, 64, 3, seed=1))
    torch.testing.assert_close(start[1:], starting_images(votes[1:], spec, 64, 64, 3, seed=0))


def test_a_search_from_a_constant_image_begins_at_grain_of_its_seed() -> None:
    spec, flat = presets.uoctti(8), torch.full((1, 1, 24, 32), 0.5)
    image = photograph(64)[..., :24, :32]
    votes = histograms(image, spec)
    first, again, other = (start_near(votes, spec, flat, image, seed)[0] for seed in (0, 0, 1))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
    assert 0 < float(first.std()) < 2 * START_NOISE
    assert torch.equal(start_near(votes, spec, image, flat, 0)[0], start_near(votes, spec, image, flat, 1)[0])


RECTANGULAR = [presets.uoctti((8, 4)), presets.paper(8), presets.paper((8, 4)), presets.paper((4, 8))]


@pytest.mark.parametrize("spec", RECTANGULAR, ids=["signed", "square", "high", "wide"])
def test_a_starting_image_has_about_the_contrast_of_the_votes(spec: HOGSpec) -> None:
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    image = (0.5 + 0.3 * torch.exp(-((x - 30).square() + (y - 34).square()) / 300)).double()[None, None]
    start = starting_images(histograms(image, spec), spec, 64, 64, 1, seed=0)
    assert 0.6 < (start.std() / image.std()).item() < 1.3  # a mean of sign patterns is fainter than each


def test_noise_is_seeded_the_same_in_every_batch_and_cancels_in_pairs() -> None:
    before = torch.get_rng_state()
    pairs = pair_noise(LIKE, 40, 50, 3, seed=3, spread=0.2)
    assert torch.equal(torch.get_rng_state(), before)
    assert pairs.shape == (1, 3, 1, 40, 50)
    assert pairs.std().item() == pytest.approx(0.2, rel=0.1)
    assert torch.equal(pairs[:, 2], -pairs[:, 0])
    assert torch.equal(pairs[:, :2], noise(LIKE, 40, 50, 2, seed=3, spread=0.2))
    assert not torch.equal(noise(LIKE, 40, 50, 1, seed=4), noise(LIKE, 40, 50, 1, seed=3))


@BOTH
def test_at_contrast_is_the_projection_of_the_histograms(spec: HOGSpec) -> None:
    images = torch.cat([photograph(32), photograph(32, "coins")]).double()
    votes = histograms(images.flip(0), spec)
    made = match_contrast(images, votes, spec)
    own = histograms(made, spec)
    torch.testing.assert_close((own * (votes - own)).sum(dim=(1, 2, 3)), torch.zeros(2, dtype=torch.float64))
    torch.testing.assert_close(match_contrast(0.2 + 0.3 * images, votes, spec), made)
    constant = torch.full_like(images, 0.2)
    torch.testing.assert_close(match_contrast(constant, votes, spec), torch.full_like(images, 0.5))


def test_images_are_stretched_to_the_unit_range_or_shifted_where_the_contrast_is_known() -> None:
    ramp = torch.linspace(-3, 5, 10_000).reshape(1, 1, 100, 100)
    stretched = to_unit_range(ramp, presets.uoctti())
    assert ((stretched == 0) | (stretched == 1)).float().mean().item() == pytest.approx(0.01, abs=1e-3)
    assert stretched[0, 0, 0, 0] < stretched[0, 0, -1, -1]
    shifted = to_unit_range(ramp / 16 + 9, presets.paper())  # Eq. 7 as printed fixes the contrast
    torch.testing.assert_close(shifted, ramp / 16 + 0.5 - 1 / 16, atol=1e-3, rtol=0)
    assert torch.equal(to_unit_range(torch.ones(1, 1, 4, 4), presets.uoctti()), torch.full((1, 1, 4, 4), 0.5))
