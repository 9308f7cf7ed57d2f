"""The dogleg, step by step against a dense reference, and where its matrices are singular or its steps fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.hog import hog, presets
from nablahog.invert.prior.terms import RelativeSmoothness
from nablahog.invert.search import PreimageObjective
from nablahog.invert.unknowns import FlatRegions
from nablahog.optimize import Jacobian, StopReason, dogleg
from nablahog.optimize.dogleg import next_radius
from nablahog.optimize.gauss_newton import GraphJacobian, NewtonSteps, newton_steps

from . import chumpy
from .problems import CASES, SumOfSquares, beale, exponentials, rosenbrock

# conjugate gradients as good as a direct solution, and no steps at the level of rounding
EXACT = {"cg_iterations": 600, "cg_tolerance": 1e-12, "max_evaluations": 100_000, "gradient_tolerance": 1e-6}


def network(seed: int) -> Callable[[Tensor], Tensor]:
    """Nine residuals of six unknowns, curved everywhere, by fixed random numbers."""
    generator = torch.Generator().manual_seed(seed)
    inner, outer = (torch.randn(9, 6, generator=generator, dtype=torch.float64) for _ in range(2))
    target = torch.randn(9, generator=generator, dtype=torch.float64)
    return lambda x: torch.sin(2 * x @ inner.T) + (x**2) @ outer.T / 2 - target


def compare(problem: SumOfSquares, start: Tensor, iterations: int, radius: float | None = None) -> list[bool]:
    """Our trial points beside Chumpy's, for one problem (1, N).  Returns which were accepted."""
    index = torch.zeros(1, dtype=torch.long)

    def function(x: Tensor) -> Tensor:
        return problem.function(x[None], index)[0]

    tried, accepted = chumpy.dogleg(
        lambda p: function(torch.from_numpy(p)).numpy(),
        lambda p: torch.autograd.functional.jacobian(function, torch.from_numpy(p)).numpy(),
        start[0].numpy(),
        iterations,
        radius,
        e_1=EXACT["gradient_tolerance"],
    )
    result = dogleg(problem, start, max_iterations=iterations, radius=radius, **EXACT)
    # Chumpy tries one and the same rejected step until the radius cuts it; we once
    new = [i for i in range(len(tried)) if i == 0 or not np.array_equal(tried[i], tried[i - 1])]
    ours = [p[0].numpy() for p in problem.points[1:]]
    assert len(ours) == len(new)
    for mine, i in zip(ours, new, strict=True):
        np.testing.assert_allclose(mine, tried[i], rtol=0, atol=1e-8)
    end = max(i for i in range(len(tried)) if accepted[i])
    np.testing.assert_allclose(result.x[0].numpy(), tried[end], rtol=0, atol=1e-8)
    return [accepted[i] for i in new]


@pytest.mark.parametrize("radius", [None, 0.3, 1e-3])
@pytest.mark.parametrize(
    ("function", "n"), [(rosenbrock, 2), (beale, 2), (exponentials, 3), (network(0), 6), (network(1), 6)]
)
def test_steps_are_those_of_chumpy(function: Callable[[Tensor], Tensor], n: int, radius: float | None) -> None:
    start = torch.randn(1, n, generator=torch.Generator().manual_seed(n), dtype=torch.float64)
    if function is rosenbrock:
        start = CASES["rosenbrock"].points()
    accepted = compare(SumOfSquares(lambda x, index: function(x)), start, 12, radius)
    if function is rosenbrock and radius is None:
        assert not all(accepted)  # a rejected step is among them


class Pixels:
    """Gray values as unknowns, which vmap can map, unlike the cosine transform."""

    def image(self, unknowns: Tensor) -> Tensor:
        return unknowns.reshape(-1, 1, 8, 8).clone()

    def adjoint(self, grad_image: Tensor) -> Tensor:
        return grad_image.flatten(1)


@pytest.mark.slow
def test_steps_of_an_inversion_are_those_of_chumpy() -> None:
    spec = presets.paper(4)
    generator = torch.Generator().manual_seed(0)
    image, noise = (torch.rand(1, 1, 8, 8, generator=generator, dtype=torch.float64) for _ in range(2))
    descriptor, pixels = hog(image, spec), Pixels()
    terms: list[Any] = [FlatRegions(descriptor, spec, 8, 8), [RelativeSmoothness(0.02)], image.flip(3), 0.1]
    objective = PreimageObjective(descriptor, None, spec, pixels, *terms)  # type: ignore[arg-type]
    problem = SumOfSquares(objective.residuals)
    accepted = compare(problem, noise.flatten(1), 3)
    assert sum(accepted) == 3
    # the same through the objective's own value and gradient
    result = dogleg(objective, noise.flatten(1), max_iterations=3, **EXACT)
    torch.testing.assert_close(result.x, problem.points[-1], rtol=0, atol=1e-8)


def conjugate_gradients(jacobian: Jacobian, descent: Tensor, iterations: int) -> NewtonSteps:
    """So many, whatever it costs and however long the steps."""
    radius, budget = torch.full_like(descent[:, 0], torch.inf), torch.full((len(descent),), 10**6)
    steps, products, found = newton_steps(jacobian, descent, radius, budget, iterations, 1e-12)
    assert found.all()
    assert (products <= 2 * iterations - 1).all()
    return steps


def test_singular_equations_give_the_shortest_step() -> None:
    generator = torch.Generator().manual_seed(0)
    A = torch.randn(5, 3, generator=generator, dtype=torch.float64) @ torch.randn(3, 8, generator=generator).double()
    b = torch.randn(5, generator=generator, dtype=torch.float64)
    problem = SumOfSquares(lambda x, index: x @ A.T - b)
    start = torch.zeros(1, 8, dtype=torch.float64)
    jacobian = GraphJacobian(problem, start, torch.tensor([0]))
    steps = conjugate_gradients(jacobian, b[None] @ A, 3)  # the rank
    torch.testing.assert_close(steps.step[0], torch.linalg.pinv(A) @ b)
    torch.testing.assert_close(steps.image[0], A @ steps.step[0])
    # and the whole search stops there, as no step lowers the value any more
    result = dogleg(problem, start, cg_tolerance=1e-12, gradient_tolerance=1e-12)
    assert result.stop_reason == [StopReason.GRADIENT]
    torch.testing.assert_close(result.x[0], torch.linalg.pinv(A) @ b)


class Preconditioned(GraphJacobian):
    """Scaled by the diagonal of JᵀJ."""

    def __init__(self, problem: SumOfSquares, points: Tensor, index: Tensor, diagonal: Tensor) -> None:
        super().__init__(problem, points, index)
        self.diagonal = diagonal

    def precondition(self, vectors: Tensor) -> Tensor:
        return vectors / self.diagonal


def test_a_preconditioner_saves_products_and_leaves_the_solution() -> None:
    generator = torch.Generator().manual_seed(0)
    scales = torch.logspace(0, 3, 8, dtype=torch.float64)
    A = (torch.eye(8, dtype=torch.float64) + 0.1 * torch.randn(8, 8, generator=generator, dtype=torch.float64)) * scales
    b = torch.randn(8, generator=generator, dtype=torch.float64)

    class Scaled(SumOfSquares):
        def linearize(self, points: Tensor, index: Tensor) -> Preconditioned:
            return Preconditioned(self, points, index, A.square().sum(0))

    start, rows = torch.zeros(1, 8, dtype=torch.float64), torch.tensor([0])
    reached = {}
    for kind in (SumOfSquares, Scaled):
        problem = kind(lambda x, index: x @ A.T - b)
        jacobian = problem.linearize(start, rows) if kind is Scaled else GraphJacobian(problem, start, rows)
        steps = conjugate_gradients(jacobian, b[None] @ A, 6)
        reached[kind] = float((A @ steps.step[0] - b).norm())
        result = dogleg(problem, start, cg_iterations=100, cg_tolerance=1e-12)
        torch.testing.assert_close(result.x[0], torch.linalg.solve(A, b), rtol=1e-6, atol=1e-9)
    assert reached[Scaled] < reached[SumOfSquares] / 100


def test_what_has_no_residuals_is_refused() -> None:
    with pytest.raises(TypeError, match=r"a problem with residuals .* got function"):
        dogleg(lambda points, index: (points.square().sum(1), 2 * points), torch.ones(1, 2))


def test_the_radius_after_a_trial() -> None:
    """Chumpy's rule, for a step of length 1.5 in a radius of 2: at a limit itself the radius stays."""

    def after(gain: float, accepted: bool = True) -> float:
        numbers = (torch.tensor([number], dtype=torch.float64) for number in (2.0, 1.5, gain))
        return float(next_radius(*numbers, torch.tensor([accepted])))

    radii = [after(gain) for gain in (0.04, 0.05, 0.5, 0.9, 0.91)]
    assert radii == [0.5, 2, 2, 2, 3.75]
    assert after(-1, accepted=False) == 0.5


def test_accepted_steps_are_told() -> None:
    told: list[tuple[int, float]] = []
    problem = SumOfSquares(lambda x, index: rosenbrock(x))

    def accepted(index: Tensor, iterations: Tensor, points: Tensor) -> None:
        assert index.tolist() == [0]
        told.append((int(iterations), float(problem.function(points, index).square().sum())))

    result = dogleg(problem, torch.tensor([[-1.2, 1.0]]).double(), max_iterations=5, accepted=accepted)
    assert [iteration for iteration, _ in told] == [1, 2, 3, 4, 5]
    assert [value for _, value in told] == sorted((value for _, value in told), reverse=True)
    assert told[-1][1] == pytest.approx(float(result.value))
    assert result.stop_reason == [StopReason.ITERATIONS]


def test_a_gradient_that_lies_collapses_the_radius() -> None:
    class Liar(SumOfSquares):
        def __call__(self, points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
            value, gradient = super().__call__(points, index)
            return value, -gradient

    problem = Liar(lambda x, index: x - 3)
    start = torch.ones(2, 3, dtype=torch.float64)
    result = dogleg(problem, start)
    assert result.stop_reason == [StopReason.RADIUS] * 2
    assert torch.equal(result.x, start)
    assert dogleg(problem, start, radius=1e-16).stop_reason == [StopReason.STEP] * 2


@pytest.mark.parametrize("budget", range(1, 16))
def test_the_budget_counts_products_too(budget: int) -> None:
    class Counted(SumOfSquares):
        halves = 0

    problem = Counted(lambda x, index: network(3)(x))
    start = torch.ones(1, 6, dtype=torch.float64)
    jvp, vjp = GraphJacobian.jvp, GraphJacobian.vjp

    def counted(product: Callable[[GraphJacobian, Tensor], Tensor]) -> Callable[[GraphJacobian, Tensor], Tensor]:
        def call(model: GraphJacobian, vectors: Tensor) -> Tensor:
            problem.halves += 1
            return product(model, vectors)

        return call

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GraphJacobian, "jvp", counted(jvp))
        patch.setattr(GraphJacobian, "vjp", counted(vjp))
        result = dogleg(problem, start, max_evaluations=budget, cg_tolerance=1e-12)
    halves = problem.halves + problem.linearised + 2 * len(problem.points)
    assert halves <= 2 * budget
    assert result.evaluations.tolist() == [(halves + 1) // 2]
    assert result.history.shape == (int(result.evaluations[0]), 1)
    assert result.stop_reason == [StopReason.BUDGET]
    if budget >= 3:  # conjugate gradients were cut short, and their step tried
        assert len(problem.points) >= 2
