"""Multi-scale and multi-scale-more: levels, their descriptors, and how one leads to the next."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from nablahog import HOGSpec, hog, presets
from nablahog.invert import AsPublished, Level, Objective, Search, multiscale, reconstruct_multiscale, scale_descriptors
from nablahog.invert.multiscale import _choose_level_settings
from nablahog.invert.reconstruction import find_negatives, negate
from nablahog.invert.scales import SCALES, level_spec

from .photographs import correlation, photograph

SPECS = {
    "signed": dataclasses.replace(presets.paper(8), signed=True, bins=18),
    "paper": presets.paper(8),
    "paper-robust": presets.paper(8, global_form="robust"),
}
PAPER = SPECS["paper"]
FEW = Search(max_evaluations=16)
all_specs = pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)
both_variants = pytest.mark.parametrize("more", [False, True], ids=["multi-scale", "multi-scale-more"])


def descriptors(image: Tensor, spec: HOGSpec, more: bool, scales: tuple[int, ...] = SCALES) -> Tensor | list[Tensor]:
    return scale_descriptors(image, spec, scales) if more else hog(image, spec)


def images(levels: list[Level]) -> list[Tensor]:
    return [level.reconstruction.image for level in levels]


def distance(level: Level, descriptor: Tensor) -> Tensor:
    residual = hog(level.reconstruction.image, level.spec) - descriptor
    return residual.flatten(1).norm(dim=1) / descriptor.flatten(1).norm(dim=1)


def test_a_scale_is_a_square_that_divides_cell_and_image() -> None:
    for cell, size, scale, says in (
        ((8, 8), (64, 64), 2, "square number of at least 1, got 2"),
        ((8, 6), (64, 48), 16, r"64x48 pixels with cells of 8x6 has no scale 1/16.*multiples of 4"),
        ((8, 8), (61, 64), 4, r"61x64 pixels.*multiples of 2"),
    ):
        with pytest.raises(ValueError, match=says):
            level_spec(presets.paper(cell), scale, size)


@pytest.mark.slow
def test_scale_descriptors_are_those_of_averaged_images() -> None:
    image = torch.cat([photograph(64), photograph(64, "coins")])[..., :48].double()
    result = scale_descriptors(image, PAPER)
    for descriptor, factor in zip(result, (8, 4, 2, 1), strict=True):
        small, _ = level_spec(PAPER, factor**2, (64, 48))
        mean = image.unfold(2, factor, factor).unfold(3, factor, factor).mean(dim=(4, 5))
        torch.testing.assert_close(descriptor, hog(mean, small))
    with pytest.raises(ValueError, match="no scale 1/4"):
        scale_descriptors(image[..., :47], PAPER, (4, 1))


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "more"), [(presets.uoctti, True), (presets.uoctti, False), (presets.paper, True)])
def test_levels_grow_and_report_their_own_distance(preset: Any, more: bool) -> None:
    spec, size = preset((8, 16)), (32, 48)
    inputs = descriptors(photograph(64, "coins")[..., :32, -48:], spec, more)
    levels = reconstruct_multiscale(inputs, spec, search=FEW, prior=None)
    assert [level.scale for level in levels] == [64, 16, 4, 1]
    for i, (level, factor) in enumerate(zip(levels, (8, 4, 2, 1), strict=True)):
        result = level.reconstruction
        assert result.image.shape == (1, 1, size[0] // factor, size[1] // factor)
        assert level.spec.cell_size == (8 // factor, 16 // factor)
        assert 0 <= result.image.min() <= result.image.max() <= 1
        assert result.evaluations.max() <= (16 if factor == 1 else 4)
        if isinstance(inputs, list):
            torch.testing.assert_close(result.distance, distance(level, inputs[i]))
    assert levels[-1].spec == spec
    assert (levels[-1].reconstruction.distance < 0.8).all()


@all_specs
def test_every_level_is_given_the_descriptor_at_the_contrast_of_its_size(spec: HOGSpec) -> None:
    descriptor = hog(photograph(32), spec)
    for level in reconstruct_multiscale(descriptor, spec, search=FEW, prior=None):
        # a smaller image of the same contrast has steeper, but fewer gradients
        own = descriptor / level.scale**0.25 if spec.normalizer.fixes_contrast else descriptor
        torch.testing.assert_close(level.reconstruction.distance, distance(level, own))


def test_the_printed_normalisers_scale_is_that_of_a_smooth_image() -> None:
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    image = (0.5 + 0.2 * torch.sin(x / 12) * torch.cos(y / 9)).double()[None, None]
    full, *_ = reversed(scales := scale_descriptors(image, PAPER, (16, 4, 1)))
    for descriptor, scale in zip(scales, (16, 4, 1), strict=True):
        assert (descriptor.norm() / full.norm()).item() == pytest.approx(scale**-0.25, rel=0.1)


@pytest.mark.slow
@all_specs
@both_variants
def test_a_photograph_comes_back(spec: HOGSpec, more: bool) -> None:
    image = photograph(64)
    inputs, scales = descriptors(image, spec, more, (16, 4, 1)), (16, 4, 1)
    calls: list[tuple[int, int]] = []
    options: dict[str, Any] = {"search": Search(max_evaluations=60), "progress": lambda *call: calls.append(call)}
    levels = reconstruct_multiscale(inputs, spec, scales=scales, **options, prior=None)
    assert levels[-1].reconstruction.distance[0] < 0.35
    if spec.signed:
        assert correlation(levels[-1].reconstruction.image, image) > 0.85
        assert correlation(levels[0].reconstruction.image, avg_pool2d(image, 4)) > 0.8
    for small, large in pairwise(levels):  # each begins where the one before ended
        assert correlation(small.reconstruction.image, avg_pool2d(large.reconstruction.image, 2)) > 0.7
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert {most for _, most in calls} == {2 * 15 + 60}
    assert done[-1] == 30 + levels[-1].reconstruction.evaluations.max() <= 90


def test_a_flat_image_ends_every_level_early() -> None:
    levels = reconstruct_multiscale(hog(torch.full((1, 1, 32, 32), 0.7), PAPER), PAPER, prior=None)
    assert all(level.reconstruction.distance.item() == 0 for level in levels)
    assert levels[-1].reconstruction.image.unique().numel() == 1


def test_a_level_without_texture_does_not_end_those_after_it() -> None:
    y, x = torch.meshgrid(torch.arange(32), torch.arange(32), indexing="ij")
    checkers = (0.2 + 0.6 * ((x // 2 + y // 2) % 2))[None, None]  # gray but for the last two levels
    inputs, few = scale_descriptors(checkers, PAPER), Search(max_evaluations=40)
    result = reconstruct_multiscale(inputs, PAPER, search=few, prior=None)
    assert result[-2].reconstruction.distance.item() < 0.9
    assert result[-1].reconstruction.distance.item() < 0.5


@pytest.mark.slow
def test_the_last_level_has_the_descriptors_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    spec, scales = presets.uoctti(8), (16, 4, 1)
    inputs = scale_descriptors(photograph(64), spec, scales)
    apart = []
    for weight in (0.0, 0.1):
        monkeypatch.setattr(multiscale, "COARSER_WEIGHT", weight)
        levels = reconstruct_multiscale(inputs, spec, scales=scales, search=Search(max_evaluations=60), prior=None)
        result = scale_descriptors(levels[-1].reconstruction.image, spec, scales)
        apart.append(sum(float((a - b).norm() / b.norm()) for a, b in zip(result[:-1], inputs[:-1], strict=True)))
    assert apart[1] < 0.8 * apart[0]


def test_partial_cells_where_the_size_is_given() -> None:
    spec = dataclasses.replace(SPECS["signed"], partial_cells="ceil")
    image = photograph(64)[..., :44, :52]  # 5.5 and 6.5 cells, rounded up
    levels = reconstruct_multiscale(hog(image, spec), spec, (44, 52), scales=(4, 1), search=FEW, prior=None)
    assert [tuple(image.shape[2:]) for image in images(levels)] == [(22, 26), (44, 52)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["signed", "paper"])
@both_variants
def test_batch_equals_loop_and_the_seed_decides(name: str, more: bool) -> None:
    spec, both = SPECS[name], torch.cat([photograph(32), photograph(32, "coins")]).double()

    def run(image: Tensor, seed: int = 0) -> list[Tensor]:
        given = descriptors(image, spec, more)
        return images(reconstruct_multiscale(given, spec, search=FEW, seed=seed, prior=None))

    together, alone, other = run(both), run(both[:1]), run(both[:1], seed=1)
    for all_, one, another in zip(together, alone, other, strict=True):
        torch.testing.assert_close(all_[:1], one, atol=1e-5, rtol=0)
        assert not torch.equal(one, another)


@pytest.mark.slow
def test_the_last_level_decides_the_polarity_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = set()
    for picture in ("camera", "coins", "brick"):
        descriptor = hog(photograph(32, picture), PAPER)
        chosen = images(reconstruct_multiscale(descriptor, PAPER, search=FEW, prior=None))
        with monkeypatch.context() as context:
            context.setattr(multiscale, "find_negatives", lambda image, confidence: (torch.tensor([False]), confidence))
            found = images(reconstruct_multiscale(descriptor, PAPER, search=FEW, prior=None))
        turned = find_negatives(found[-1])[0]
        assert all(torch.equal(b, negate(a, turned)) for a, b in zip(found, chosen, strict=True))
        kinds.add(bool(turned))
    assert kinds == {True, False}


def test_closeness_keeps_levels_together() -> None:
    descriptor = hog(photograph(32), PAPER)

    def agreement(closeness: float) -> float:
        options: dict[str, Any] = {"search": Search(max_evaluations=40), "objective": Objective(closeness=closeness)}
        small, large = reconstruct_multiscale(descriptor, PAPER, scales=(4, 1), **options, prior=None)
        return correlation(small.reconstruction.image, avg_pool2d(large.reconstruction.image, 2))

    assert agreement(10.0) > agreement(0.0)


def test_refused_input() -> None:
    descriptor = torch.zeros(1, 4, 4, 9)
    wrong: list[tuple[Any, dict[str, Any], str]] = [
        (descriptor, {"scales": ()}, "scales must be integers"),
        (descriptor, {"scales": (4, 4)}, "scales must fall"),
        ([descriptor] * 3, {}, "4 in all, got 3"),
        (descriptor, {"scales": (9, 1)}, "multiples of 3"),
        (descriptor, {"image_size": (64, 64)}, r"must have shape \(8, 8, 9\)"),
    ]
    for inputs, options, says in wrong:
        with pytest.raises(ValueError, match=says):
            reconstruct_multiscale(inputs, PAPER, **options, prior=None)


def test_budgets_of_levels() -> None:
    """A quarter of the last level's, at most 120 evaluations."""
    spec = presets.uoctti(8)
    descriptor = torch.zeros(1, 4, 4, 31)

    def budgets(search: Search, published: AsPublished | None = None) -> list[int]:
        levels = _choose_level_settings([descriptor] * 3, True, spec, None, (16, 4, 1), search, published)
        return [level.most for level in levels]

    for most, coarse in ((4, 2), (100, 25), (480, 120), (600, 120)):
        assert budgets(Search(max_evaluations=most)) == [coarse, coarse, most]
    for iterations, coarse in ((1, 1), (9, 2), (40, 10)):
        assert budgets(Search(), AsPublished(iterations=iterations)) == [coarse, coarse, iterations]
