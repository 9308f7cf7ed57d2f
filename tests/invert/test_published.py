"""The paper's own search: Eq. 9, its Jacobians, and the way from noise to an image."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import HOGSpec, hog, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import AsPublished, Objective, Search, default_prior, scale_descriptors
from nablahog.invert.published import DIAGONAL_SHARE, PublishedObjective, _centre, choose_smoothness

from .photographs import photograph

SIZE = 24, 16
SPECS = presets.uoctti(), presets.paper(), presets.opencv(gamma=False)
ONCE, QUICK = AsPublished(iterations=1), AsPublished(iterations=3)
SPEC = presets.uoctti()


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def photographs(count: int, side: int) -> Tensor:
    return torch.cat([photograph(side, name) for name in ("camera", "coins", "moon")[:count]])


def problem(spec: HOGSpec, xi: float = 0.5) -> tuple[PublishedObjective, Tensor, Tensor]:
    """The objective of two random images, points, and their indices, in reverse order."""
    images = torch.rand(2, 1, *SIZE, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    objective = PublishedObjective(hog(images, spec.with_linear_votes()), spec.with_linear_votes(), SIZE, xi)
    return objective, 0.2 * random(2, math.prod(SIZE)), torch.tensor([1, 0])


@pytest.mark.filterwarnings("ignore:images of floats:UserWarning")  # points of a search may be negative
def test_the_value_is_equation_9_squared() -> None:
    spec, xi = presets.paper(), 0.3
    objective, points, index = problem(spec, xi)
    value, _ = objective(points, index)
    for row, image in enumerate(points.reshape(-1, 1, *SIZE)):
        distance = float((hog(image[None], spec)[0] - objective.descriptor[index[row]].permute(1, 2, 0)).norm())
        gray = image[0].numpy()
        squares = (np.diff(gray, axis=0) ** 2).sum() + (np.diff(gray, axis=1) ** 2).sum()
        assert float(value[row]) == pytest.approx(distance**2 + xi**2 * squares, rel=1e-9)
        length = float(objective.descriptor[index[row]].norm())
        assert float(objective.distance[index[row]]) == pytest.approx(distance / length)


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_the_jacobian_is_that_of_the_residuals(spec: HOGSpec) -> None:
    objective, points, index = problem(spec)
    jacobian = objective.linearize(points, index)
    residuals = objective.residuals(points, index)
    assert jacobian.size == residuals.shape[1]
    v, u = random(*points.shape, seed=2), random(*residuals.shape, seed=3)
    _, image = torch.func.jvp(lambda p: objective.residuals(p, index), (points,), (v,))
    torch.testing.assert_close(jacobian.jvp(v), image)
    torch.testing.assert_close((jacobian.vjp(u) * v).sum(1), (u * image).sum(1))
    value, gradient = objective(points, index)
    torch.testing.assert_close(value, residuals.square().sum(1))
    torch.testing.assert_close(gradient, 2 * jacobian.vjp(residuals))


def test_the_preconditioner_is_the_laplacian_plus_a_share_of_the_diagonal() -> None:
    xi, pixels = 2.0, math.prod(SIZE)
    objective, points, index = problem(presets.uoctti(), xi)
    jacobian = objective.linearize(points, index)
    at = torch.eye(pixels, dtype=torch.float64)[:1].repeat(2, 1)
    inverse = jacobian.precondition(at)
    for row in range(2):
        seen = torch.func.jacrev(lambda p: objective.residuals(p[None], index[row : row + 1])[0])(points[row])  # noqa: B023
        neighbours = seen[-objective.neighbour_differences(objective.images(points)).shape[1] :]
        of_hog = seen[: -len(neighbours)].square().sum() / pixels  # the mean diagonal, which one probe estimates
        rest = (at[row] - neighbours.T @ (neighbours @ inverse[row])) / inverse[row]
        assert float(rest.std() / rest.mean().abs()) < 1e-3
        assert 0.3 < float(rest.mean()) / (DIAGONAL_SHARE * float(of_hog)) < 3


@pytest.mark.slow
def test_finds_an_image_from_noise_and_keeps_the_iterates() -> None:
    descriptor = hog(photographs(1, 24), SPEC)
    result = reconstruct(descriptor, SPEC, method=AsPublished(iterations=6, keep_iterates=True))
    assert result.distance < 0.25
    assert result.iterates is not None
    distances = (hog(result.iterates[:, 0], SPEC) - descriptor).flatten(1).norm(dim=1) / descriptor.norm()
    assert distances[0] > 0.5 > 2 * distances[-1]
    assert result.iterates.shape == (7, 1, 1, 24, 24)
    assert torch.equal(result.iterates[-1], result.image)
    assert result.history.shape == (int(result.evaluations.max()), 1)
    array = reconstruct(descriptor[0].numpy(), SPEC, method=AsPublished(iterations=1, keep_iterates=True))
    assert (array.image.shape, array.iterates.shape) == ((24, 24), (2, 24, 24))


@pytest.mark.slow
@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_the_distance_from_a_descriptor_of_zeros_is_absolute(spec: HOGSpec) -> None:
    descriptor = torch.zeros_like(hog(photograph(32), spec))
    result = reconstruct(descriptor, spec, (32, 32), method=QUICK)
    torch.testing.assert_close(result.distance, hog(result.image, spec).flatten(1).norm(dim=1))
    assert result.history.max() < 100
    assert reconstruct(descriptor, spec, (32, 32), prior=None, quality="fast").distance == 0


@pytest.mark.slow
def test_another_default_dtype_gives_the_same() -> None:
    descriptor = hog(photographs(1, 24), SPEC)
    expected = reconstruct(descriptor, SPEC, method=ONCE).image
    for dtype in (torch.float64, torch.float16):
        torch.set_default_dtype(dtype)
        try:
            image = reconstruct(descriptor, SPEC, method=ONCE).image
        finally:
            torch.set_default_dtype(torch.float32)
        assert torch.equal(image, expected)


@pytest.mark.slow
def test_the_seed_and_the_start_decide() -> None:
    image = photographs(1, 24)
    descriptor = hog(image, SPEC)
    one, again, other = (reconstruct(descriptor, SPEC, method=ONCE, seed=seed) for seed in (0, 0, 1))
    assert torch.equal(one.image, again.image)
    assert not torch.equal(one.image, other.image)
    assert reconstruct(descriptor, SPEC, method=ONCE, start=image).distance < one.distance
    assert reconstruct(descriptor, SPEC, method=ONCE, start=torch.full_like(image, 0.5)).distance < 1


@pytest.mark.slow
def test_a_batch_in_parts_is_its_images_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = presets.paper()
    descriptors, calls = hog(photographs(3, 32), spec).double(), []
    kept = AsPublished(iterations=4, keep_iterates=True)
    whole = reconstruct(descriptors, spec, method=kept)
    monkeypatch.setattr("nablahog.invert.published.PIXELS_AT_ONCE", 2 * 32 * 32)
    parts = reconstruct(descriptors, spec, method=kept, progress=lambda done, most: calls.append((done, most)))
    torch.testing.assert_close(parts.image, whole.image, rtol=0, atol=1e-6)
    torch.testing.assert_close(parts.iterates, whole.iterates, rtol=0, atol=1e-6)
    assert {most for _, most in calls} == {8}
    assert calls == sorted(calls)
    alone = reconstruct(descriptors[1:2], spec, method=kept)
    torch.testing.assert_close(whole.image[1:2], alone.image, rtol=0, atol=1e-6)
    assert whole.evaluations[1] == alone.evaluations[0]


@pytest.mark.slow
@pytest.mark.parametrize("more", [False, True])
def test_levels(more: bool) -> None:
    spec, image = presets.paper(), photographs(1, 32)
    given = scale_descriptors(image, spec) if more else hog(image, spec)
    calls: list[tuple[int, int]] = []
    levels = reconstruct_multiscale(given, spec, method=AsPublished(iterations=8), progress=lambda *c: calls.append(c))
    assert [level.reconstruction.image.shape[-1] for level in levels] == [4, 8, 16, 32]
    assert levels[-1].reconstruction.distance < 0.9
    assert calls[-1] == (14, 14)  # a quarter of the iterations at each level before the last


def test_options_of_the_default_method_are_refused() -> None:
    for name, value in {
        "quality": "fast",
        "search": Search(max_evaluations=9),
        "objective": Objective(smoothness=1),
        "expected": torch.zeros(1, 1, 16, 16),
        "prior": [default_prior(SPEC)],
    }.items():
        with pytest.raises(ValueError, match=f"{name} is an option of the default method"):
            reconstruct(hog(torch.rand(1, 1, 16, 16), SPEC), SPEC, method="paper", **{name: value})  # type: ignore[arg-type]


def test_the_default_smoothness() -> None:
    assert choose_smoothness(AsPublished(), presets.uoctti()) == 100
    assert choose_smoothness(AsPublished(), presets.paper()) == 0.3


def test_starts_have_the_contrast_of_the_noise() -> None:
    grain, images = 1e-4 * torch.randn(1, 16, 16), torch.rand(2, 1, 16, 16)
    centred = _centre(images, grain, presets.uoctti(8))
    torch.testing.assert_close(centred.square().mean(dim=(1, 2, 3)), grain.square().mean().expand(2))
    torch.testing.assert_close(_centre(0.3 + images / 2, grain, presets.uoctti(8)), centred, atol=1e-8, rtol=1e-3)
