"""Priors: their formulas, their derivatives, and the squares they are made of."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.invert.priors import (
    EPSILON,
    Norm,
    Prior,
    Range,
    RelativeSmoothness,
    Smoothness,
    TotalVariation,
    smoothness,
)

PRIORS = {
    "relative": RelativeSmoothness(0.7),
    "absolute": Smoothness(0.7),
    "absolute, 8": Smoothness(0.7, neighbours=8),
    "squared": Smoothness(0.7, "squared"),
    "squared, 8": Smoothness(0.7, "squared", 8),
    "tv": TotalVariation(0.7, beta=1),
    "tv^1.5": TotalVariation(0.7, beta=1.5),
    "tv^2": TotalVariation(0.7),
    "norm^2": Norm(0.7, alpha=2),
    "norm^3": Norm(0.7, alpha=3),
    "norm^6": Norm(0.7),
    "range": Range(0.7),
}
all_priors = pytest.mark.parametrize("prior", PRIORS.values(), ids=PRIORS)


def images(batch: int = 2, height: int = 7, width: int = 6) -> Tensor:
    """In -0.5…1.5."""
    unit = torch.rand(batch, 1, height, width, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return 2 * unit - 0.5


def as_printed(prior: Prior, image: np.ndarray) -> float:
    """Loops over pixels, no rounding off."""
    height, width = image.shape
    total = 0.0
    for y in range(height):
        for x in range(width):
            if isinstance(prior, Smoothness):
                ahead = [(0, 1), (1, 0)] + ([(1, 1), (1, -1)] if prior.neighbours == 8 else [])
                for dy, dx in ahead:
                    if y + dy < height and 0 <= x + dx < width:
                        d = abs(image[y + dy, x + dx] - image[y, x])
                        total += d if prior.form == "absolute" else d**2
            elif isinstance(prior, TotalVariation):
                dx = image[y, x + 1] - image[y, x] if x + 1 < width else 0
                dy = image[y + 1, x] - image[y, x] if y + 1 < height else 0
                total += (dx**2 + dy**2) ** (prior.beta / 2)
            elif isinstance(prior, Norm):
                total += abs(image[y, x] - image.mean()) ** prior.alpha
            elif isinstance(prior, Range):
                total += max(image[y, x] - 1, 0 - image[y, x], 0) ** 2 / image.size
    return prior.weight * total


@all_priors
def test_is_the_formula(prior: Prior) -> None:
    batch = images()
    if isinstance(prior, RelativeSmoothness):
        torch.testing.assert_close(prior(batch), prior.weight * smoothness(batch))
        return
    for image, value in zip(batch, prior(batch), strict=True):
        assert value.item() == pytest.approx(as_printed(prior, image[0].numpy()), rel=1e-3)


@all_priors
def test_is_the_sum_of_its_squares(prior: Prior) -> None:
    batch = torch.cat([images(), torch.full((1, 1, 7, 6), 0.3, dtype=torch.float64), 1e-4 * images(1)])
    terms = prior.residuals(batch)
    assert terms.shape[0] == 4
    torch.testing.assert_close(terms.square().sum(1), prior(batch))


@all_priors
def test_derivatives_are_central_differences(prior: Prior) -> None:
    batch = images(1, 4, 5).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: prior(x), batch, atol=1e-6)
    assert torch.autograd.gradcheck(lambda x: prior.residuals(x), batch, atol=1e-6)


@all_priors
def test_constant_images_have_finite_derivatives(prior: Prior) -> None:
    for dtype in (torch.float32, torch.float64):
        image = torch.full((1, 1, 8, 8), 0.3, dtype=dtype).requires_grad_()
        (gradient,) = torch.autograd.grad(prior(image).sum(), image)
        assert gradient.abs().max() < 1e-5
        jacobian = torch.autograd.functional.jacobian(prior.residuals, image.detach())
        assert torch.isfinite(jacobian).all()
        if not isinstance(prior, RelativeSmoothness):  # which is no sum over differences alone
            assert prior(image).item() == pytest.approx(0, abs=1e-9)


@all_priors
@pytest.mark.parametrize("size", [(1, 1), (1, 6), (5, 1), (2, 2)])
def test_images_of_a_few_pixels(prior: Prior, size: tuple[int, int]) -> None:
    image = images(2, *size).requires_grad_()
    (gradient,) = torch.autograd.grad(prior(image).sum() + prior.residuals(image).sum(), image)
    assert torch.isfinite(gradient).all()


@all_priors
def test_no_prior_but_the_range_sees_the_brightness(prior: Prior) -> None:
    if isinstance(prior, Range):
        assert (prior(images() + 3) > prior(images())).all()
        return
    torch.testing.assert_close(prior(images() + 3), prior(images()))


@all_priors
def test_weight_scales(prior: Prior) -> None:
    torch.testing.assert_close(dataclasses.replace(prior, weight=1.4)(images()), 2 * prior(images()))
    assert (dataclasses.replace(prior, weight=0).residuals(images()) == 0).all()


def test_gauss_newton_sees_the_curvature_of_small_differences() -> None:
    # at equal neighbours the terms have a slope, though the prior has none
    for prior in (RelativeSmoothness(1), Smoothness(1)):
        image = images(1)
        image[..., 3, 3] = image[..., 3, 2]
        jacobian = torch.autograd.functional.jacobian(prior.residuals, image)[0, :, 0, 0]
        term = (prior.residuals(image)[0] == 0).nonzero().item()
        assert jacobian[term, 3, 3] == -jacobian[term, 3, 2] != 0


def test_powers_are_rounded_off_below_epsilon_only() -> None:
    step = torch.zeros(1, 1, 1, 2, dtype=torch.float64)
    for d in (EPSILON / 100, EPSILON, 10 * EPSILON, 1.0):
        step[..., 1] = d
        assert Smoothness(1)(step).item() <= d
        assert Smoothness(1)(step).item() == pytest.approx(d, rel=(EPSILON / d) ** 2)


def test_range_is_zero_with_no_gradient_inside() -> None:
    inside = torch.tensor([0.0, 0.2, 0.5, 1.0], dtype=torch.float64).reshape(1, 1, 2, 2).requires_grad_()
    value = Range(3.0)(inside)
    assert value.item() == 0
    assert (torch.autograd.grad(value.sum(), inside)[0] == 0).all()
    outside = torch.tensor([1.5, -0.1, 0.5, 1.0], dtype=torch.float64).reshape(1, 1, 2, 2).requires_grad_()
    value = Range(3.0)(outside)
    assert value.item() == pytest.approx(3 * (0.5**2 + 0.1**2) / 4)
    expected = 3 * 2 / 4 * torch.tensor([0.5, -0.1, 0, 0], dtype=torch.float64).reshape(1, 1, 2, 2)
    torch.testing.assert_close(torch.autograd.grad(value.sum(), outside)[0], expected)


def test_range_is_the_same_for_an_image_and_its_negative() -> None:
    torch.testing.assert_close(Range(1.0)(images()), Range(1.0)(1 - images()))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Smoothness(-1.0), "weight.*at least 0, got -1"),
        (lambda: RelativeSmoothness(float("nan")), "weight.*finite"),
        (lambda: Smoothness(1, "cubed"), "'absolute' or 'squared', got 'cubed'"),
        (lambda: Smoothness(1, neighbours=6), "4 or 8, got 6"),
        (lambda: TotalVariation(1, beta=0.5), "beta.*at least 1, got 0.5"),
        (lambda: Range(-2.0), "weight.*at least 0, got -2"),
        (lambda: Norm(1, alpha=float("inf")), "alpha.*finite.*got inf"),
    ],
)
def test_values_out_of_range(make: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=["float32", "float64"])
@pytest.mark.parametrize("size", [(7, 6), (1, 1), (1, 6), (5, 1), (2, 2), (3, 3), (40, 70)], ids=str)
@pytest.mark.parametrize("contrast", [1.0, 0.0], ids=["noise", "constant"])
def test_compiled_smoothness_is_the_plain_one(dtype: torch.dtype, size: tuple[int, int], contrast: float) -> None:
    x = (images(3, *size) * contrast + 0.2).to(dtype).requires_grad_()
    weights = torch.tensor([1.0, -2.0, 0.5], dtype=dtype)
    got, expected = RelativeSmoothness(1.0)(x), smoothness(x)
    derivatives = [torch.autograd.grad((value * weights).sum(), x)[0] for value in (got, expected)]
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    torch.testing.assert_close(got, expected, rtol=tolerance, atol=tolerance)
    torch.testing.assert_close(*derivatives, rtol=tolerance, atol=tolerance * float(derivatives[1].abs().max() + 1))
