"""Priors: their formulas, their derivatives, and the squares they are made of."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck
from torch.nn.functional import avg_pool2d
from torch.testing import assert_close

from nablahog import HOGSpec, hog, presets
from nablahog.hog.gradient import gradient
from nablahog.invert.prior.terms import CoarserDescriptor, GrayRange, Prior, RelativeSmoothness, smoothness

from .photographs import photograph

all_priors = pytest.mark.parametrize("prior", [RelativeSmoothness(0.7), GrayRange(0.7)], ids=["relative", "range"])


def images(batch: int = 2, height: int = 7, width: int = 6) -> Tensor:
    """In -0.5…1.5."""
    unit = torch.rand(batch, 1, height, width, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return 2 * unit - 0.5


def test_smoothness_ignores_contrast_and_brightness_and_sees_alternating_pixels() -> None:
    ramp = torch.linspace(0, 1, 16, dtype=torch.float64).expand(16, 16)[None, None] ** 2
    alternating = torch.ones_like(ramp)
    alternating[..., ::2] = -1
    assert smoothness(0.1 * ramp + 7).item() == pytest.approx(smoothness(ramp).item())
    assert torch.equal(gradient(alternating, presets.paper())[0], torch.zeros(1, 16, 16))  # the mask cannot see it
    assert smoothness(ramp + 0.05 * alternating) > 1.5 * smoothness(ramp)


def test_range_is_the_mean_squared_excess() -> None:
    image = torch.tensor([1.5, -0.1, 0.5, 1.0], dtype=torch.float64).reshape(1, 1, 2, 2).requires_grad_()
    value = GrayRange(3.0)(image)
    assert value.item() == pytest.approx(3 * (0.5**2 + 0.1**2) / 4)
    expected = 3 * 2 / 4 * torch.tensor([0.5, -0.1, 0, 0], dtype=torch.float64).reshape(1, 1, 2, 2)
    assert_close(torch.autograd.grad(value.sum(), image)[0], expected)


@all_priors
def test_is_the_sum_of_its_squares(prior: Prior) -> None:
    batch = torch.cat([images(), torch.full((1, 1, 7, 6), 0.3, dtype=torch.float64), 1e-4 * images(1)])
    assert_close(prior.residuals(batch).square().sum(1), prior(batch))


@all_priors
def test_derivatives_are_central_differences(prior: Prior) -> None:
    batch = images(1, 4, 5).requires_grad_()
    assert gradcheck(lambda x: prior(x), batch, atol=1e-6)
    assert gradcheck(lambda x: prior.residuals(x), batch, atol=1e-6)


@all_priors
@pytest.mark.parametrize("size", [(1, 6), (5, 1), (8, 8)])
def test_constant_images_have_finite_derivatives(prior: Prior, size: tuple[int, int]) -> None:
    image = torch.full((1, 1, *size), 0.3).requires_grad_()
    (gradient,) = torch.autograd.grad(prior(image).sum(), image)
    assert gradient.abs().max() < 1e-5
    assert torch.isfinite(torch.autograd.functional.jacobian(prior.residuals, image.detach())).all()


def test_gauss_newton_sees_the_curvature_of_small_differences() -> None:
    # at equal neighbours the terms have a slope, though the prior has none
    image = images(1)
    image[..., 3, 3] = image[..., 3, 2]
    jacobian = torch.autograd.functional.jacobian(RelativeSmoothness(1).residuals, image)[0, :, 0, 0]
    term = (RelativeSmoothness(1).residuals(image)[0] == 0).nonzero().item()
    assert jacobian[term, 3, 3] == -jacobian[term, 3, 2] != 0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=["float32", "float64"])
@pytest.mark.parametrize("size", [(1, 1), (1, 6), (3, 3), (40, 70)], ids=str)
def test_compiled_smoothness_is_the_plain_one(dtype: torch.dtype, size: tuple[int, int]) -> None:
    x = torch.cat([images(2, *size), images(1, *size) * 0 + 0.2]).to(dtype).requires_grad_()
    weights = torch.tensor([1.0, -2.0, 0.5], dtype=dtype)
    got, expected = RelativeSmoothness(1.0)(x), smoothness(x)
    derivatives = [torch.autograd.grad((value * weights).sum(), x)[0] for value in (got, expected)]
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    assert_close(got, expected, rtol=tolerance, atol=tolerance)
    assert_close(*derivatives, rtol=tolerance, atol=tolerance * float(derivatives[1].abs().max() + 1))


@pytest.mark.parametrize("spec", [presets.paper(4), presets.uoctti(4)], ids=["paper", "uoctti"])
def test_a_coarser_descriptor_is_compared_by_its_relative_distance(spec: HOGSpec) -> None:
    batch = torch.cat([photograph(32), photograph(32, "coins")]).double()
    target = hog(avg_pool2d(batch.flip(2), 2), spec)
    prior = CoarserDescriptor(0.7, target, spec, 2)
    apart = (hog(avg_pool2d(batch, 2), spec) - target).flatten(1).norm(dim=1) / target.flatten(1).norm(dim=1)
    assert_close(prior(batch), 0.7 * apart.square())
    assert_close(prior.residuals(batch).square().sum(dim=1), prior(batch))
    assert_close(prior.select(torch.tensor([1]))(batch[1:]), prior(batch)[1:])
    silent = CoarserDescriptor(0.7, torch.zeros_like(target), spec, 2)
    assert torch.equal(silent(batch), torch.zeros(2, dtype=torch.float64))
    small = torch.rand(2, 1, 16, 16, generator=torch.Generator().manual_seed(0), dtype=torch.float64).requires_grad_()
    prior = CoarserDescriptor(0.7, hog(avg_pool2d(small.detach().flip(2), 2), spec), spec, 2)
    assert gradcheck(prior, (small,), fast_mode=True)
    assert gradcheck(prior.residuals, (small,), fast_mode=True)


def test_values_out_of_range() -> None:
    for make in (lambda: RelativeSmoothness(float("nan")), lambda: GrayRange(-2.0)):
        with pytest.raises(ValueError, match="must be a finite number of at least"):
            make()
