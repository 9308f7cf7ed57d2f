"""The parts of a reconstruction, each against what it claims."""

from __future__ import annotations

import pytest
import torch

from nablahog.hog import hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.gradient import gradient
from nablahog.hog.normalize import normalize
from nablahog.invert.flat import FlatRegions
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.parameterize import CosineBasis, Pixels
from nablahog.invert.preimage import to_unit_range
from nablahog.invert.priors import smoothness
from nablahog.invert.start import integrate, mean_gradient, starting_image

from .photographs import photograph

LIKE = torch.zeros(1, dtype=torch.float64)


@pytest.mark.parametrize("basis", [Pixels(12, 17), CosineBasis(12, 17, LIKE), CosineBasis(12, 17, LIKE, exponent=0)])
def test_unknowns_and_images_are_inverse(basis: Pixels | CosineBasis) -> None:
    image = torch.rand(3, 1, 12, 17, dtype=torch.float64)
    torch.testing.assert_close(basis.image(basis.unknowns(image)), image)


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


def test_flat_regions_leave_a_textured_image_alone() -> None:
    spec = presets.uoctti(8)
    noise = torch.rand(2, 1, 32, 32)
    assert torch.equal(FlatRegions(hog(noise, spec), spec, 32, 32)(noise, torch.arange(2)), noise)


@pytest.mark.parametrize("image", [photograph(64).double(), torch.zeros(1, 1, 64, 64).double()])
def test_printed_normaliser_is_undone_exactly(image: torch.Tensor) -> None:
    spec = presets.paper(8)
    torch.testing.assert_close(recover_histograms(hog(image, spec), spec), histograms(image, spec))


def test_robust_normaliser_is_undone_up_to_contrast() -> None:
    spec = presets.paper(8, global_form="robust")
    found, true = (
        f(photograph(64).double())
        for f in (lambda x: recover_histograms(hog(x, spec), spec), lambda x: histograms(x, spec))
    )
    torch.testing.assert_close(found / found.sum(), true / true.sum())


@pytest.mark.parametrize("name", ["camera", "astronaut", "coffee"])
def test_block_normaliser_is_undone_up_to_contrast(name: str) -> None:
    spec = presets.uoctti(8)
    image = photograph(128, name)
    descriptor, true = hog(image, spec), histograms(image, spec)
    found = recover_histograms(descriptor, spec)
    error = (normalize(found, spec).permute(0, 2, 3, 1) - descriptor).norm() / descriptor.norm()
    assert error < 0.03
    assert (found / found.sum() - true / true.sum()).norm() < 0.2 * (true / true.sum()).norm()


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


def test_starting_image_looks_like_the_photograph_for_signed_votes_only() -> None:
    image = photograph(64)
    signed, unsigned = presets.uoctti(8), presets.paper(8)
    start = starting_image(histograms(image, signed), signed, 64, 64, seed=0)
    assert torch.corrcoef(torch.stack([start.flatten(), image.flatten()]))[0, 1] > 0.8
    noise = starting_image(histograms(image, unsigned), unsigned, 64, 64, seed=0)
    assert torch.corrcoef(torch.stack([noise.flatten(), image.flatten()]))[0, 1].abs() < 0.1
    assert torch.equal(noise, starting_image(histograms(image, unsigned), unsigned, 64, 64, seed=0))
    assert not torch.equal(noise, starting_image(histograms(image, unsigned), unsigned, 64, 64, seed=1))


def test_brightness_rule() -> None:
    ramp = torch.linspace(-3, 5, 10_000).reshape(1, 1, 100, 100)
    stretched = to_unit_range(ramp, presets.uoctti())
    assert (stretched.min(), stretched.max()) == (0, 1)
    assert ((stretched == 0) | (stretched == 1)).float().mean().item() == pytest.approx(0.01, abs=1e-3)
    shifted = to_unit_range(ramp / 16 + 9, presets.paper())  # Eq. 7 as printed fixes the contrast
    torch.testing.assert_close(shifted, ramp / 16 + 0.5 - 1 / 16, atol=1e-3, rtol=0)
    assert torch.equal(to_unit_range(torch.ones(1, 1, 4, 4), presets.uoctti()), torch.full((1, 1, 4, 4), 0.5))
