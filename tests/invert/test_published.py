"""The paper's own search: Eq. 9, its Jacobians, and the way from noise to an image."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad

from nablahog import HOGSpec, hog, presets, reconstruct, reconstruct_multiscale
from nablahog.hog.engines import histograms, histograms_jvp
from nablahog.invert import AsPublished, Objective, Search, scale_descriptors
from nablahog.invert.method import Neighbours, Norms
from nablahog.invert.priors import EPSILON
from nablahog.invert.published_objective import DIAGONAL, PublishedObjective

from .photographs import photograph

SIZE = 24, 16
SPECS = presets.uoctti(), presets.paper(), presets.opencv()
NORMS: tuple[Norms, ...] = ("squared", "printed")
QUICK = AsPublished(iterations=4, level_iterations=2, cg_iterations=30)


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def photographs(count: int, side: int) -> Tensor:
    return torch.cat([photograph(side, name) for name in ("camera", "coins", "moon")[:count]])


def problem(
    spec: HOGSpec, norms: Norms, xi: float = 0.5, neighbours: Neighbours = 4
) -> tuple[PublishedObjective, Tensor, Tensor]:
    """The objective of two random images, points, and their indices, in reverse order."""
    images = torch.rand(2, 1, *SIZE, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    spec = spec.with_linear_votes()
    if spec.gamma == "sqrt":
        spec = presets.opencv(gamma=False)
    return (
        PublishedObjective(hog(images, spec), spec, SIZE, xi, norms, neighbours),
        0.2 * random(2, math.prod(SIZE)),
        torch.tensor([1, 0]),
    )


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("norms", NORMS)
def test_the_value_is_equation_9(norms: Norms, neighbours: Neighbours) -> None:
    spec, xi = presets.paper(), 0.3
    objective, points, index = problem(spec, norms, xi, neighbours)
    value, _ = objective(points, index)
    for row, image in enumerate(points.reshape(-1, 1, *SIZE)):
        distance = float((hog(image[None], spec)[0] - objective.descriptor[index[row]].permute(1, 2, 0)).norm())
        gray = image[0].numpy()
        pairs = [np.diff(gray, axis=0), np.diff(gray, axis=1)]
        if neighbours == 8:
            pairs += [gray[1:, 1:] - gray[:-1, :-1], gray[1:, :-1] - gray[:-1, 1:]]
        steps = np.concatenate([pair.ravel() for pair in pairs])
        squared = distance**2 + xi**2 * (steps**2).sum()
        printed = distance + xi * (steps**2 / np.sqrt(steps**2 + EPSILON**2)).sum()
        assert float(value[row]) == pytest.approx(squared if norms == "squared" else printed, rel=1e-9)
        assert abs(printed - distance - xi * np.abs(steps).sum()) < xi * EPSILON * len(steps)
        length = float(objective.descriptor[index[row]].norm())
        assert float(objective.distance[index[row]]) == pytest.approx(distance / length)


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("norms", NORMS)
@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_the_jacobian_is_that_of_the_residuals(spec: HOGSpec, norms: Norms, neighbours: Neighbours) -> None:
    objective, points, index = problem(spec, norms, neighbours=neighbours)
    jacobian = objective.linearize(points, index)
    residuals = objective.residuals(points, index)
    assert jacobian.size == residuals.shape[1]
    v, u = random(*points.shape, seed=2), random(*residuals.shape, seed=3)
    _, image = torch.func.jvp(lambda p: objective.residuals(p, index), (points,), (v,))
    (pulled,) = torch.func.vjp(lambda p: objective.residuals(p, index), points)[1](u)
    torch.testing.assert_close(jacobian.jvp(v), image, rtol=1e-7, atol=1e-8)
    torch.testing.assert_close(jacobian.vjp(u), pulled, rtol=1e-7, atol=1e-8)
    torch.testing.assert_close(jacobian.jvp(v), image, rtol=1e-7, atol=1e-8)  # the graph is kept
    value, gradient = objective(points, index)
    torch.testing.assert_close(value, residuals.square().sum(1))
    torch.testing.assert_close(gradient, 2 * jacobian.vjp(residuals), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("norms", NORMS)
def test_the_preconditioner_undoes_the_smoothness(norms: Norms) -> None:
    objective, points, index = problem(presets.uoctti(), norms, xi=2.0)
    jacobian = objective.linearize(points, index)
    pixels = math.prod(SIZE)
    grid = np.arange(pixels).reshape(SIZE)
    pairs = [*zip(grid[:-1].ravel(), grid[1:].ravel(), strict=True)]
    pairs += [*zip(grid[:, :-1].ravel(), grid[:, 1:].ravel(), strict=True)]
    differences = torch.zeros(len(pairs), pixels, dtype=torch.float64)
    for row, (p, q) in enumerate(pairs):
        differences[row, p], differences[row, q] = 1, -1
    laplacian = differences.T @ differences
    inverse = jacobian.precondition(torch.eye(pixels, dtype=torch.float64)[:1].repeat(2, 1))
    for row in range(2):
        applied = laplacian @ inverse[row]
        seen = torch.func.jacrev(lambda p: objective.residuals(p[None], index[row : row + 1])[0])(points[row])  # noqa: B023
        of_hog = seen[: -len(pairs)].square().sum() / pixels  # the mean diagonal, of which one probe is an estimate
        weight = seen[-len(pairs) :].square().sum() / len(pairs) / 2
        rest = (torch.eye(pixels, dtype=torch.float64)[0] - weight * applied) / inverse[row]
        assert float(rest.std() / rest.mean().abs()) < 1e-3
        assert 0.3 < float(rest.mean()) / (DIAGONAL * float(of_hog)) < 3


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
@pytest.mark.parametrize("compiled", [True, False])
def test_histograms_jvp_is_forward_mode(spec: HOGSpec, compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    images, tangents = torch.rand(2, 1, *SIZE, dtype=torch.float64), random(2, 1, *SIZE)
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(images, tangents)
        expected = forward_ad.unpack_dual(histograms(dual, spec)).tangent
    monkeypatch.setattr(import_module("nablahog.hog.kernels"), "supports", lambda spec: compiled)
    torch.testing.assert_close(histograms_jvp(images, tangents, spec), expected)


def test_finds_an_image_from_noise() -> None:
    spec, image = presets.uoctti(), photographs(1, 48)
    descriptor = hog(image, spec)
    more = AsPublished(iterations=25, keep_iterates=True)
    result = reconstruct(descriptor, spec, method=more)
    assert result.distance < 0.25
    distances = (hog(result.iterates[:, 0], spec) - descriptor).flatten(1).norm(dim=1) / descriptor.norm()
    assert distances[0] > 0.5 > 2 * distances[-1]
    assert result.iterates.shape == (26, 1, 1, 48, 48)
    assert torch.equal(result.iterates[-1], result.image)
    torch.testing.assert_close(distances[-1:], result.distance)
    assert result.history.shape == (int(result.evaluations.max()), 1)


def test_the_seed_decides() -> None:
    spec = presets.uoctti()
    descriptor = hog(photographs(1, 32), spec)
    image = reconstruct(descriptor, spec, method=QUICK).image
    assert torch.equal(reconstruct(descriptor, spec, method=QUICK).image, image)
    assert not torch.equal(reconstruct(descriptor, spec, method=QUICK, seed=1).image, image)


def test_a_batch_is_its_images_alone() -> None:
    spec = presets.paper()
    descriptors = hog(photographs(2, 32), spec).double()
    together = reconstruct(descriptors, spec, method=QUICK)
    for k in range(2):
        alone = reconstruct(descriptors[k : k + 1], spec, method=QUICK)
        torch.testing.assert_close(together.image[k : k + 1], alone.image, rtol=0, atol=1e-6)
        assert together.evaluations[k] == alone.evaluations[0]


def test_parts_of_a_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = presets.paper()
    descriptors, calls = hog(photographs(3, 32), spec).double(), []
    kept = AsPublished(**{**vars(QUICK), "keep_iterates": True})
    whole = reconstruct(descriptors, spec, method=kept)
    monkeypatch.setattr("nablahog.invert.published.AT_ONCE", 2 * 32 * 32)
    parts = reconstruct(descriptors, spec, method=kept, progress=lambda done, most: calls.append((done, most)))
    torch.testing.assert_close(parts.image, whole.image, rtol=0, atol=1e-6)
    torch.testing.assert_close(parts.iterates, whole.iterates, rtol=0, atol=1e-6)
    assert {most for _, most in calls} == {8}
    assert calls == sorted(calls)
    assert calls[-1][0] <= 8


def test_arrays() -> None:
    spec = presets.uoctti()
    descriptor = hog(photographs(1, 32), spec)[0].numpy()
    result = reconstruct(descriptor, spec, method=AsPublished(iterations=2, cg_iterations=5, keep_iterates=True))
    assert result.image.shape == (32, 32)
    assert result.iterates.shape == (3, 32, 32)


def test_a_start_and_a_course() -> None:
    spec, image = presets.uoctti(), photographs(1, 32)
    descriptor = hog(image, spec)
    near = reconstruct(descriptor, spec, method=QUICK, start=image)
    assert near.distance < reconstruct(descriptor, spec, method=QUICK).distance
    assert reconstruct(descriptor, spec, method=QUICK, start=torch.full_like(image, 0.5)).distance < 1
    course = AsPublished(smoothness=[100.0, 1.0], iterations=2, cg_iterations=10, keep_iterates=True)
    assert reconstruct(descriptor, spec, method=course).iterates.shape[0] == 5


@pytest.mark.parametrize("more", [False, True])
def test_levels(more: bool) -> None:
    spec, image = presets.paper(), photographs(1, 32)
    given = scale_descriptors(image, spec) if more else hog(image, spec)
    levels = reconstruct_multiscale(given, spec, method=QUICK)
    assert [level.reconstruction.image.shape[-1] for level in levels] == [4, 8, 16, 32]
    assert levels[-1].reconstruction.distance < 0.9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quality": "fast"}, "quality is an option of the default method"),
        ({"search": Search(max_evaluations=9)}, "search is an option of the default method"),
        ({"objective": Objective(smoothness=1)}, "objective is an option of the default method"),
        ({"expected": torch.zeros(1, 1, 16, 16)}, "expected is an option of the default method"),
        ({"method": "publisched"}, "method must be"),
    ],
)
def test_refusals(options: dict[str, Any], message: str) -> None:
    spec = presets.uoctti()
    with pytest.raises(ValueError, match=message):
        reconstruct(hog(torch.rand(1, 1, 16, 16), spec), spec, **{"method": "paper", **options})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"smoothness": 0.0}, "smoothness must be a finite number above 0"),
        ({"smoothness": []}, "smoothness must be"),
        ({"noise": -1.0}, "noise must be"),
        ({"norms": "cubed"}, "norms must be"),
        ({"neighbours": 6}, "neighbours must be"),
        ({"iterations": 0}, "iterations must be at least 1"),
        ({"cg_tolerance": 1.0}, "cg_tolerance must be between 0 and 1"),
        ({"max_evaluations": 1}, "max_evaluations must be at least 2"),
    ],
)
def test_options_out_of_range(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AsPublished(**options)
