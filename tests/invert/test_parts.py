"""The parts of a reconstruction, each against what it claims."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from nablahog import native
from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.gradient import gradient
from nablahog.hog.steps import normalize_reference
from nablahog.invert.cosine_transform import cosines
from nablahog.invert.flat import FlatRegions
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.parameterize import CosineBasis, Pixels, low_pass
from nablahog.invert.priors import smoothness
from nablahog.invert.reconstruction import to_unit_range
from nablahog.invert.start import (
    NOISE,
    at_contrast,
    enlarge,
    in_pairs,
    integrate,
    mean_gradient,
    noise,
    starting_images,
)

from .photographs import photograph

LIKE = torch.zeros(1, dtype=torch.float64)


@pytest.mark.parametrize("basis", [Pixels(12, 17), CosineBasis(12, 17, LIKE), CosineBasis(12, 17, LIKE, exponent=0)])
def test_unknowns_and_images_are_inverse(basis: Pixels | CosineBasis) -> None:
    image = torch.rand(3, 1, 12, 17, dtype=torch.float64)
    torch.testing.assert_close(basis.image(basis.unknowns(image)), image)


@pytest.mark.parametrize("basis", [Pixels(12, 17), CosineBasis(12, 17, LIKE)])
def test_what_reaches_the_unknowns_is_what_autograd_finds(basis: Pixels | CosineBasis) -> None:
    unknowns = torch.rand(3, 12 * 17, dtype=torch.float64, requires_grad=True)
    to_image = torch.rand(3, 1, 12, 17, dtype=torch.float64)
    (expected,) = torch.autograd.grad(basis.image(unknowns), unknowns, to_image)
    torch.testing.assert_close(basis.adjoint(to_image), expected)


def test_cosine_basis_is_orthonormal_and_scaled_by_frequency() -> None:
    unweighted = CosineBasis(9, 14, LIKE, exponent=0)
    image = torch.rand(1, 1, 9, 14, dtype=torch.float64)
    torch.testing.assert_close(unweighted.unknowns(image).norm(), image.norm())
    unit = torch.zeros(1, 16 * 16, dtype=torch.float64)
    unit[0, 3 * 16] = 1  # frequency 3 along y
    torch.testing.assert_close(CosineBasis(16, 16, LIKE, 1.0).image(unit).norm().item(), 1 / 3)


def test_smoothness_ignores_contrast_and_brightness_and_sees_alternating_pixels() -> None:
    ramp = torch.linspace(0, 1, 16, dtype=torch.float64).expand(16, 16)[None, None] ** 2
    alternating = torch.ones_like(ramp)
    alternating[..., ::2] = -1
    assert smoothness(0.1 * ramp + 7).item() == pytest.approx(smoothness(ramp).item())
    assert torch.equal(gradient(alternating, presets.paper())[0], torch.zeros(1, 16, 16))  # the mask cannot see it
    assert smoothness(ramp + 0.05 * alternating) > 1.5 * smoothness(ramp)


def test_smoothness_of_a_constant_image_has_a_finite_gradient() -> None:
    image = torch.full((1, 1, 8, 8), 0.3, requires_grad=True)
    (derivative,) = torch.autograd.grad(smoothness(image).sum(), image)
    assert torch.isfinite(derivative).all()


def test_flat_regions_are_found_made_constant_and_silent() -> None:
    spec = presets.uoctti(8)
    image = photograph(64).clone()
    image[..., :, :40] = 1.0
    descriptor = hog(image, spec)
    flat = FlatRegions(descriptor, spec, 64, 64)
    index = torch.zeros(1, dtype=torch.long)
    noise = torch.rand_like(image)
    made = flat(noise, index)
    known = flat.regions[0] > 0
    assert known[1:-1, 1:34].all()  # the corners of the ring, which does not vote, remain unknown
    assert not known[:, 44:].any()
    assert made[0, 0][known].unique().numel() == 1
    torch.testing.assert_close(made[0, 0][known][0], noise[0, 0][known].mean())
    assert torch.equal(made[0, 0][~known], noise[0, 0][~known])
    empty = (descriptor == 0).all(-1)
    assert empty.any()
    assert (hog(made, spec)[empty] == 0).all()
    torch.testing.assert_close(flat(made, index), made)


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
def test_flat_regions_are_levelled_by_a_projection(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(native, "available", lambda: False)
    image = photograph(48).double()
    image[..., :20, :20], image[..., 30:, 30:] = 0.2, 0.9
    regions = FlatRegions(hog(image.repeat(2, 1, 1, 1), presets.uoctti(8)), presets.uoctti(8), 48, 48)
    assert len(regions.sizes) > 3
    index, pixels = torch.tensor([1, 0]), torch.rand(2, 1, 48, 48, dtype=torch.float64, requires_grad=True)
    levelled = regions(pixels, index)
    expected = pixels.detach().clone()
    for label in range(1, len(regions.sizes)):
        of_it = (regions.regions[index] == label).unsqueeze(1)
        if of_it.any():
            expected[of_it] = expected[of_it].mean()
    torch.testing.assert_close(levelled, expected)
    with torch.no_grad():
        assert torch.equal(regions.level(pixels.clone(), index), levelled)
        torch.testing.assert_close(regions(levelled, index), levelled)
    given = torch.rand_like(pixels)
    (result,) = torch.autograd.grad(levelled, pixels, given)
    torch.testing.assert_close(result, regions(given, index))  # its own adjoint
    tangent = torch.func.jvp(lambda x: regions(x, index), (pixels.detach(),), (given,))[1]
    torch.testing.assert_close(tangent, regions(given, index))


def test_flat_regions_leave_a_textured_image_alone() -> None:
    spec = presets.uoctti(8)
    noise = torch.rand(2, 1, 32, 32)
    assert torch.equal(FlatRegions(hog(noise, spec), spec, 32, 32)(noise, torch.arange(2)), noise)


@pytest.mark.parametrize("image", [photograph(64).double(), torch.zeros(1, 1, 64, 64).double()])
def test_printed_normaliser_is_undone_exactly(image: Tensor) -> None:
    spec = presets.paper(8)
    torch.testing.assert_close(recover_histograms(hog(image, spec), spec), histograms(image, spec))


def test_robust_normaliser_is_undone_up_to_contrast() -> None:
    spec = presets.paper(8, global_form="robust")
    result, true = (
        f(photograph(64).double())
        for f in (lambda x: recover_histograms(hog(x, spec), spec), lambda x: histograms(x, spec))
    )
    torch.testing.assert_close(result / result.sum(), true / true.sum())


@pytest.mark.parametrize("name", ["camera", "astronaut", "coffee"])
def test_block_normaliser_is_undone_up_to_contrast(name: str) -> None:
    spec = presets.uoctti(8)
    image = photograph(128, name)
    descriptor, true = hog(image, spec), histograms(image, spec)
    result = recover_histograms(descriptor, spec)
    error = (normalize_reference(result, spec).permute(0, 2, 3, 1) - descriptor).norm() / descriptor.norm()
    assert error < 0.03
    assert (result / result.sum() - true / true.sum()).norm() < 0.2 * (true / true.sum()).norm()


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


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


def test_starting_images_look_like_the_photograph_up_to_the_sign_if_unsigned() -> None:
    image = photograph(64)
    signed, unsigned = presets.uoctti(8), presets.paper(8)
    assert correlation(starting_images(histograms(image, signed), signed, 64, 64, 1, seed=0), image) > 0.8
    start = starting_images(histograms(image, unsigned), unsigned, 64, 64, 1, seed=0)
    assert abs(correlation(start, image)) > 0.6


@pytest.mark.parametrize("spec", [presets.uoctti(8), presets.paper(8)], ids=["signed", "unsigned"])
def test_starting_images_differ_by_seed_and_number_but_not_by_batch(spec: HOGSpec) -> None:
    votes = histograms(torch.cat([photograph(64), photograph(64, "coins")]).double(), spec)
    start = starting_images(votes, spec, 64, 64, 3, seed=0)
    assert start.shape == (2, 3, 1, 64, 64)
    assert start.dtype == torch.float64
    assert start.mean().item() == pytest.approx(0.5, abs=0.01)
    assert torch.equal(start, starting_images(votes, spec, 64, 64, 3, seed=0))
    assert not torch.equal(start[:, 0], start[:, 1])
    assert not torch.equal(start, starting_images(votes, spec, 64, 64, 3, seed=1))
    torch.testing.assert_close(start[1:], starting_images(votes[1:], spec, 64, 64, 3, seed=0))


@pytest.mark.parametrize(
    "spec", [presets.uoctti(8), presets.uoctti((8, 4)), presets.paper(8)], ids=["signed", "rectangular", "unsigned"]
)
def test_a_starting_image_has_about_the_contrast_of_the_votes(spec: HOGSpec) -> None:
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    image = (0.5 + 0.3 * torch.exp(-((x - 30).square() + (y - 34).square()) / 300)).double()[None, None]
    start = starting_images(histograms(image, spec), spec, 64, 64, 1, seed=0)
    assert 0.6 < (start.std() / image.std()).item() < 1.3  # a mean of sign patterns is fainter than each


def test_noise_is_seeded_and_the_same_in_every_batch_and_precision() -> None:
    one, several = noise(LIKE, 40, 50, 1, seed=3), noise(LIKE, 40, 50, 4, seed=3, spread=0.2)
    assert one.shape == (1, 1, 1, 40, 50)
    assert several.shape == (1, 4, 1, 40, 50)
    for result, spread in ((one, NOISE), (several, 0.2)):
        assert result.std().item() == pytest.approx(spread, rel=0.1)
        assert abs(result.mean().item()) < 0.1 * spread
    assert torch.equal(one, noise(LIKE.expand(7, 1), 40, 50, 1, seed=3))
    assert torch.equal(one.float(), noise(LIKE.float(), 40, 50, 1, seed=3))
    assert not torch.equal(one, noise(LIKE, 40, 50, 1, seed=4))
    before = torch.get_rng_state()
    noise(LIKE, 4, 5, 1, seed=3)
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_noise_in_pairs_cancels(count: int) -> None:
    result = in_pairs(LIKE, 40, 50, count, seed=3, spread=0.2)
    assert result.shape == (1, count, 1, 40, 50)
    assert torch.equal(result[:, : (count + 1) // 2], noise(LIKE, 40, 50, (count + 1) // 2, seed=3, spread=0.2))
    assert torch.equal(result[:, (count + 1) // 2 :], -result[:, : count // 2])


@pytest.mark.parametrize("spec", [presets.uoctti(8), presets.paper(8)], ids=["uoctti", "paper"])
def test_at_contrast_is_the_projection_of_the_histograms(spec: HOGSpec) -> None:
    images, others = (
        torch.cat([photograph(32, name) for name in names]).double()
        for names in (("camera", "coins"), ("coffee", "astronaut"))
    )
    votes = histograms(others, spec)
    made = at_contrast(images, votes, spec)
    torch.testing.assert_close(made.mean(dim=(1, 2, 3)), torch.full((2,), 0.5, dtype=torch.float64))
    own = histograms(made, spec)
    torch.testing.assert_close((own * (votes - own)).sum(dim=(1, 2, 3)), torch.zeros(2, dtype=torch.float64))
    torch.testing.assert_close(at_contrast(0.2 + 0.3 * images, votes, spec), made)
    torch.testing.assert_close(
        at_contrast(images, histograms(images, spec), spec), images - images.mean((2, 3), True) + 0.5
    )
    constant = torch.full_like(images, 0.2)
    torch.testing.assert_close(at_contrast(constant, votes, spec), torch.full_like(images, 0.5))
    silent = torch.zeros_like(votes)
    torch.testing.assert_close(at_contrast(images, silent, spec), torch.full_like(images, 0.5))


def test_enlarge_keeps_constants_and_its_own_size() -> None:
    image = torch.rand(2, 3, 5, 7)
    assert enlarge(image, 5, 7) is image
    assert enlarge(image, 10, 21).shape == (2, 3, 10, 21)
    torch.testing.assert_close(enlarge(torch.full((1, 1, 5, 7), 0.3), 11, 13), torch.full((1, 1, 11, 13), 0.3))


@pytest.mark.parametrize("sigma", [0.0, 1.0, 2.5])
def test_low_pass_damps_each_cosine_by_its_frequency(sigma: float) -> None:
    height, width = 9, 14
    for ky, kx in ((0, 0), (0, 1), (3, 0), (5, 8), (8, 13)):
        rows, cols = (cosines(n, LIKE.dtype, LIKE.device) for n in (height, width))
        mode = torch.outer(rows[ky], cols[kx])[None, None]
        damping = math.exp(-0.5 * (math.pi * sigma) ** 2 * ((ky / height) ** 2 + (kx / width) ** 2))
        torch.testing.assert_close(low_pass(mode, sigma), damping * mode)


def test_low_pass_keeps_constants_and_is_a_gaussian() -> None:
    constant = torch.full((2, 1, 8, 5), 0.7, dtype=torch.float64)
    torch.testing.assert_close(low_pass(constant, 2.0), constant)
    impulse = torch.zeros(1, 1, 41, 41, dtype=torch.float64)
    impulse[..., 20, 20] = 1
    distance = torch.arange(-20, 21, dtype=torch.float64)
    bell = torch.exp(-distance.square() / (2 * 2.0**2)) / (2.0 * math.sqrt(2 * math.pi))
    torch.testing.assert_close(low_pass(impulse, 2.0)[0, 0], torch.outer(bell, bell), atol=1e-6, rtol=0)
    image = torch.rand(3, 1, 8, 5)
    assert low_pass(image, 1.0).dtype == torch.float32
    torch.testing.assert_close(low_pass(image, 1.0).mean(dim=(1, 2, 3)), image.mean(dim=(1, 2, 3)))


def test_brightness_rule() -> None:
    ramp = torch.linspace(-3, 5, 10_000).reshape(1, 1, 100, 100)
    stretched = to_unit_range(ramp, presets.uoctti())
    assert (stretched.min(), stretched.max()) == (0, 1)
    assert ((stretched == 0) | (stretched == 1)).float().mean().item() == pytest.approx(0.01, abs=1e-3)
    shifted = to_unit_range(ramp / 16 + 9, presets.paper())  # Eq. 7 as printed fixes the contrast
    torch.testing.assert_close(shifted, ramp / 16 + 0.5 - 1 / 16, atol=1e-3, rtol=0)
    assert torch.equal(to_unit_range(torch.ones(1, 1, 4, 4), presets.uoctti()), torch.full((1, 1, 4, 4), 0.5))
