"""The objective as a sum of squares, and reconstruct with other minimisers and priors than its own."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.invert import Objective, Search
from nablahog.invert.flat import FlatRegions
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.objective import PreimageObjective
from nablahog.invert.parameterize import CosineBasis, Pixels
from nablahog.invert.priors import Norm, Prior, Range, RelativeSmoothness, Smoothness, TotalVariation
from nablahog.optimize import LeastSquares, Minimiser
from nablahog.optimize.gauss_newton import GraphJacobian

from .photographs import photograph

SPECS = {"uoctti": presets.uoctti(8), "paper": presets.paper(8)}
PRIORS: tuple[Prior, ...] = (RelativeSmoothness(0.02), TotalVariation(1e-3, 1), Norm(1e-4))
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


def points(rows: int) -> Tensor:
    return torch.randn(rows, 32 * 32, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


@both_specs
@pytest.mark.parametrize("on_votes", [True, False])
@pytest.mark.parametrize("closeness", [None, 0.0, 0.7])
def test_the_value_is_the_sum_of_the_squares(name: str, on_votes: bool, closeness: float | None) -> None:
    problem = objective(name, on_votes, closeness)
    assert isinstance(problem, LeastSquares)
    index = torch.tensor([1, 0])
    value, gradient = problem(points(2), index)
    x = points(2).requires_grad_()
    residuals = problem.residuals(x, index)
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
    problem = PreimageObjective(
        descriptor,
        recover_histograms(descriptor, small) if on_votes else None,
        small,
        CosineBasis(8, 8, descriptor),
        FlatRegions(descriptor, small, 8, 8),
        (*PRIORS, Range(10.0)),
        images.flip(0),
        0.7,
    )
    at = problem.parameterization.unknowns(1.5 * torch.rand_like(images)).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda x: Value.apply(x, problem, torch.tensor([1, 0])), at, eps=1e-7, atol=1e-5, fast_mode=True
    )


@both_specs
def test_closeness_adds_the_share_of_what_is_expected(name: str) -> None:
    index = torch.tensor([1, 0])
    without, with_ = objective(name, False), objective(name, False, 0.7)
    assert with_.expected is not None
    expected = with_.expected[index] - with_.expected[index].mean(dim=(2, 3), keepdim=True)
    image = with_.image(points(2), index)
    away = image - image.mean(dim=(2, 3), keepdim=True) - expected
    share = 0.7 * away.square().sum(dim=(1, 2, 3)) / expected.square().sum(dim=(1, 2, 3))
    torch.testing.assert_close(with_(points(2), index)[0] - without(points(2), index)[0], share)
    assert torch.equal(objective(name, False, 0.0)(points(2), index)[0], without(points(2), index)[0])


def test_nothing_is_expected_of_a_constant_image() -> None:
    problem = objective("paper", True)
    made = PreimageObjective(
        problem.descriptor.permute(0, 2, 3, 1),
        problem.votes,
        problem.spec,
        problem.parameterization,
        problem.flat,
        problem.priors,
        torch.full((2, 1, 32, 32), 0.3).double(),
        0.7,
    )
    index = torch.tensor([0, 1])
    torch.testing.assert_close(made(points(2), index), problem(points(2), index))


@both_specs
@pytest.mark.parametrize("on_votes", [True, False])
def test_the_reported_distance_is_the_descriptors_whatever_is_compared(name: str, on_votes: bool) -> None:
    problem = objective(name, on_votes, 0.7)
    index = torch.tensor([1, 0])
    problem(points(2), index)
    own = hog(problem.image(points(2), index), problem.spec)
    descriptor = problem.descriptor.permute(0, 2, 3, 1)[index]
    torch.testing.assert_close(
        problem.distance[index], (own - descriptor).flatten(1).norm(dim=1) / descriptor.flatten(1).norm(dim=1)
    )


@both_specs
def test_residuals_have_products_with_their_jacobian_by_torch_func(name: str) -> None:
    problem, index = objective(name, False, 0.7), torch.tensor([0, 1])
    x, v = points(2), points(4)[2:]
    residuals, image = torch.func.jvp(lambda p: problem.residuals(p, index), (x,), (v,))
    _, pull = torch.func.vjp(lambda p: problem.residuals(p, index), x)
    u = torch.randn_like(residuals)
    torch.testing.assert_close((image * u).sum(1), (pull(u)[0] * v).sum(1))


@both_specs
def test_linearisation_is_the_jacobian_at_kinks_too(name: str) -> None:
    # 8-bit levels: flat regions, gradients on bin centres
    problem, index = objective(name, False), torch.tensor([1, 0])
    problem.parameterization = Pixels(32, 32)
    x, v = torch.cat([photograph(32, "coins"), photograph(32)]).double().flatten(1), points(2)
    model = GraphJacobian(problem, x, index)
    residuals, image = torch.func.jvp(lambda p: problem.residuals(p, index), (x,), (v,))
    torch.testing.assert_close(model.jvp(v), image)
    _, pull = torch.func.vjp(lambda p: problem.residuals(p, index), x)
    torch.testing.assert_close(model.vjp(residuals), pull(residuals)[0])
    assert torch.isfinite(image).all()


@both_specs
def test_residuals_are_evaluated_in_pieces(name: str) -> None:
    problem, index = objective(name, False, 0.7), torch.tensor([1, 0])
    whole, together = problem.residuals(points(2), index), problem(points(2), index)
    problem.votes_at_once = 1
    torch.testing.assert_close(problem.residuals(points(2), index), whole)
    torch.testing.assert_close(problem(points(2), index), together)


@both_specs
def test_reconstruct_by_dogleg(name: str) -> None:
    spec = SPECS[name]
    descriptor = hog(torch.cat([photograph(48), photograph(48, "coins")]), spec)
    calls: list[int] = []
    result = reconstruct(
        descriptor,
        spec,
        search=Search(max_evaluations=90, samples=1, minimiser="dogleg"),
        progress=lambda done, most: calls.append(done),
    )
    assert result.distance.max() < 0.2
    assert result.evaluations.max() <= 90
    assert result.history.shape == (int(result.evaluations.max()), 2)
    assert torch.isfinite(result.history).all()
    assert (result.history[-1] < result.history[0] / 2).all()
    assert calls == sorted(set(calls))
    assert calls[-1] <= result.evaluations.max()


def test_several_samples_by_dogleg() -> None:
    spec = dataclasses.replace(SPECS["paper"], signed=True, bins=18)
    descriptor = hog(torch.cat([photograph(32), photograph(32, "coins")]), spec)
    result = reconstruct(
        descriptor,
        spec,
        search=Search(max_evaluations=120, samples=3, minimiser="dogleg"),
        objective=Objective(closeness=0.1),
    )
    assert result.evaluations.max() <= 120
    assert result.history.shape == (int(result.evaluations.max()), 2)
    assert torch.isfinite(result.history).all()
    assert (result.history[-1] < 0.75 * result.history[0]).all()  # 30 evaluations each, from a start that is good


def test_a_batch_by_dogleg_equals_a_loop() -> None:
    spec = SPECS["paper"]
    descriptors = hog(torch.cat([photograph(32), photograph(32, "coins")]).double(), spec)
    together = reconstruct(descriptors, spec, search=Search(max_evaluations=60, minimiser="dogleg"))
    for i in range(2):
        alone = reconstruct(descriptors[i : i + 1], spec, search=Search(max_evaluations=60, minimiser="dogleg"))
        torch.testing.assert_close(together.image[i], alone.image[0], atol=1e-5, rtol=0)
        assert together.evaluations[i] == alone.evaluations[0]


@pytest.mark.parametrize("minimiser", ["lbfgs", "dogleg"])
def test_a_flat_photograph_by_any_minimiser(minimiser: Minimiser) -> None:
    result = reconstruct(
        hog(torch.full((1, 1, 32, 32), 0.7), SPECS["uoctti"]),
        SPECS["uoctti"],
        search=Search(max_evaluations=20, minimiser=minimiser),
    )
    assert result.distance.item() == 0


@pytest.mark.parametrize("minimiser", ["lbfgs", "dogleg"])
def test_a_prior_does_what_it_says(minimiser: Minimiser) -> None:
    spec = SPECS["paper"]
    descriptor = hog(photograph(48), spec)

    def total(image: Tensor) -> Tensor:
        return image.diff(dim=-1).abs().sum() + image.diff(dim=-2).abs().sum()

    without, with_one, with_two = (
        reconstruct(
            descriptor,
            spec,
            search=Search(max_evaluations=100, minimiser=minimiser),
            objective=Objective(smoothness=0, priors=priors),
        ).image
        for priors in ((), (Smoothness(1e-4),), [Smoothness(1e-4), TotalVariation(1e-2)])
    )
    assert total(with_two) < total(with_one) < total(without)


def test_smoothness_is_the_relative_prior() -> None:
    spec = SPECS["paper"]
    descriptor = hog(photograph(32).double(), spec)
    named = reconstruct(descriptor, spec, search=Search(max_evaluations=10), objective=Objective(smoothness=0.1)).image
    given = reconstruct(
        descriptor,
        spec,
        search=Search(max_evaluations=10),
        objective=Objective(smoothness=0, priors=[RelativeSmoothness(0.1)]),
    ).image
    torch.testing.assert_close(named, given, atol=1e-9, rtol=0)  # the sum's order differs: Range lies between
