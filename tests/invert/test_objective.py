"""The objective: its value as a sum of squares, its derivatives, and the distance it reports."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.prior.terms import GrayRange, Prior, RelativeSmoothness
from nablahog.invert.search import PreimageObjective
from nablahog.invert.unknowns import CosineBasis, FlatRegions
from nablahog.optimize import LeastSquares
from nablahog.optimize.gauss_newton import GraphJacobian

from .photographs import photograph

SPECS = {"uoctti": presets.uoctti(8), "paper": presets.paper(8)}
PRIORS: tuple[Prior, ...] = (RelativeSmoothness(0.02), GrayRange(0.5))
POINTS = torch.randn(2, 32 * 32, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
INDEX = torch.tensor([1, 0])  # each image's point is that of the other
both_specs = pytest.mark.parametrize("name", SPECS)


def two_images() -> Tensor:
    images = torch.cat([photograph(32), photograph(32, "coins")]).double()
    images[1, :, :, :20] = 0.8
    return images


@functools.cache
def recovered(name: str) -> Tensor:
    return recover_histograms(hog(two_images(), SPECS[name]), SPECS[name])


def objective(name: str, on_votes: bool, closeness: float | None = None) -> PreimageObjective:
    """Of two images, one with a flat region; with a closeness, each is expected to be the other."""
    spec, images = SPECS[name], two_images()
    descriptor = hog(images, spec)
    votes = recovered(name) if on_votes else None
    basis, flat = CosineBasis(32, 32, descriptor), FlatRegions(descriptor, spec, 32, 32)
    belief: dict[str, Any] = {} if closeness is None else {"expected": images.flip(0), "closeness": closeness}
    return PreimageObjective(descriptor, votes, spec, basis, flat, PRIORS, **belief)


@both_specs
@pytest.mark.parametrize("on_votes", [True, False])
@pytest.mark.parametrize("closeness", [None, 0.0, 0.7])
def test_the_value_is_the_sum_of_the_squares(name: str, on_votes: bool, closeness: float | None) -> None:
    problem = objective(name, on_votes, closeness)
    assert isinstance(problem, LeastSquares)
    value, gradient = problem(POINTS, INDEX)
    x = POINTS.clone().requires_grad_()
    residuals = problem.residuals(x, INDEX)
    torch.testing.assert_close(residuals.square().sum(1), value)
    torch.testing.assert_close(torch.autograd.grad(residuals, x, 2 * residuals)[0], gradient)


class Value(torch.autograd.Function):
    """An objective's values, with the gradients it returns as their derivatives."""

    @staticmethod
    def forward(context: Any, unknowns: Tensor, problem: PreimageObjective, index: Tensor) -> Tensor:
        value, gradient = problem(unknowns, index)
        context.save_for_backward(gradient)
        return value

    @staticmethod
    def backward(context: Any, *weights: Tensor) -> tuple[Tensor | None, ...]:
        return weights[0].unsqueeze(1) * context.saved_tensors[0], None, None


@both_specs
@pytest.mark.parametrize("on_votes", [True, False])
def test_gradients_are_central_differences(name: str, on_votes: bool) -> None:
    small = dataclasses.replace(SPECS[name], cell_size=(4, 4))
    images = torch.cat([photograph(8), photograph(8, "coins")]).double()
    descriptor = hog(images, small)
    votes = recover_histograms(descriptor, small) if on_votes else None
    parts = CosineBasis(8, 8, descriptor), FlatRegions(descriptor, small, 8, 8), (*PRIORS, GrayRange(10.0))
    problem = PreimageObjective(descriptor, votes, small, *parts, images.flip(0), 0.7)
    at = problem.basis.unknowns(1.5 * torch.rand_like(images)).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: Value.apply(x, problem, INDEX), at, eps=1e-7, atol=1e-5, fast_mode=True)


@both_specs
def test_closeness_adds_the_share_of_what_is_expected(name: str) -> None:
    without, with_ = objective(name, False), objective(name, False, 0.7)
    assert with_.expected is not None
    expected = with_.expected[INDEX] - with_.expected[INDEX].mean(dim=(2, 3), keepdim=True)
    image = with_.image(POINTS, INDEX)
    away = image - image.mean(dim=(2, 3), keepdim=True) - expected
    share = 0.7 * away.square().sum(dim=(1, 2, 3)) / expected.square().sum(dim=(1, 2, 3))
    torch.testing.assert_close(with_(POINTS, INDEX)[0] - without(POINTS, INDEX)[0], share)
    assert torch.equal(objective(name, False, 0.0)(POINTS, INDEX)[0], without(POINTS, INDEX)[0])


def test_nothing_is_expected_of_a_constant_image() -> None:
    problem = objective("paper", True)
    given = problem.descriptor.permute(0, 2, 3, 1), problem.histograms, problem.spec
    parts = problem.basis, problem.flat, problem.priors
    made = PreimageObjective(*given, *parts, torch.full((2, 1, 32, 32), 0.3).double(), 0.7)
    torch.testing.assert_close(made(POINTS, INDEX), problem(POINTS, INDEX))


@both_specs
@pytest.mark.parametrize("on_votes", [True, False])
def test_the_reported_distance_is_the_descriptors_whatever_is_compared(name: str, on_votes: bool) -> None:
    problem = objective(name, on_votes, 0.7)
    problem(POINTS, INDEX)
    own = hog(problem.image(POINTS, INDEX), problem.spec)
    descriptor = problem.descriptor.permute(0, 2, 3, 1)[INDEX]
    expected = (own - descriptor).flatten(1).norm(dim=1) / descriptor.flatten(1).norm(dim=1)
    torch.testing.assert_close(problem.distance[INDEX], expected)


@both_specs
def test_linearisation_is_the_jacobian_at_kinks_too(name: str) -> None:
    # 8-bit levels: flat regions, gradients on bin centres
    problem = objective(name, False)
    x, v = problem.basis.unknowns(torch.cat([photograph(32, "coins"), photograph(32)]).double()), POINTS
    model = GraphJacobian(problem, x, INDEX)
    residuals, image = torch.func.jvp(lambda p: problem.residuals(p, INDEX), (x,), (v,))
    torch.testing.assert_close(model.jvp(v), image)
    _, pull = torch.func.vjp(lambda p: problem.residuals(p, INDEX), x)
    torch.testing.assert_close(model.vjp(residuals), pull(residuals)[0])
    assert torch.isfinite(image).all()


@both_specs
def test_residuals_are_evaluated_in_pieces(name: str) -> None:
    problem = objective(name, False, 0.7)
    whole, together = problem.residuals(POINTS, INDEX), problem(POINTS, INDEX)
    problem.histograms_at_once = 1
    torch.testing.assert_close(problem.residuals(POINTS, INDEX), whole)
    torch.testing.assert_close(problem(POINTS, INDEX), together)
