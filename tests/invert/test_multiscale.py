"""Small images first, each the start of a larger one."""

from __future__ import annotations

import dataclasses
import functools
from itertools import pairwise
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from nablahog import HOGSpec, hog, presets
from nablahog.invert import Level, Objective, Search, reconstruct_multiscale, scale_descriptors
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.multiscale import SCALES, level_spec
from nablahog.invert.polarity import fix_polarity

from .photographs import photograph

SPECS = {
    "signed": dataclasses.replace(presets.paper(8), signed=True, bins=18),
    "paper": presets.paper(8),
    "paper-robust": presets.paper(8, global_form="robust"),
}
BUDGET = 16
all_specs = pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)
both_variants = pytest.mark.parametrize("more", [False, True], ids=["multi-scale", "multi-scale-more"])


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


def descriptors(image: Tensor, spec: HOGSpec, more: bool, scales: tuple[int, ...] = SCALES) -> Tensor | list[Tensor]:
    return scale_descriptors(image, spec, scales) if more else hog(image, spec)


def distance(level: Level, descriptor: Tensor) -> Tensor:
    residual = hog(level.reconstruction.image, level.spec) - descriptor
    return residual.flatten(1).norm(dim=1) / descriptor.flatten(1).norm(dim=1)


@pytest.mark.parametrize("scale", [2, 3, 8, 0, -1, -4])
def test_a_scale_is_a_square_number(scale: int) -> None:
    with pytest.raises(ValueError, match=f"square number of at least 1, got {scale}"):
        level_spec(SPECS["paper"], scale, (64, 64))


@pytest.mark.parametrize(
    ("cell", "size", "scale", "says"),
    [
        ((8, 6), (64, 48), 16, r"64x48 pixels with cells of 8x6 has no scale 1/16.*multiples of 4"),
        ((6, 8), (48, 64), 16, r"48x64 pixels with cells of 6x8"),
        ((8, 8), (64, 60), 64, r"64x60 pixels.*multiples of 8"),
        ((8, 8), (61, 64), 4, r"61x64 pixels.*multiples of 2"),
        ((8, 8), (64, 64), 9, r"multiples of 3"),
        ((1, 1), (64, 64), 4, r"cells of 1x1"),
    ],
)
def test_a_scale_divides_cell_and_image(cell: tuple[int, int], size: tuple[int, int], scale: int, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        level_spec(presets.paper(cell), scale, size)


@pytest.mark.parametrize(("cell", "size"), [((8, 8), (64, 64)), ((8, 16), (32, 64)), ((16, 8), (48, 24))])
def test_every_level_has_the_same_grid(cell: tuple[int, int], size: tuple[int, int]) -> None:
    for spec in (presets.uoctti(cell), presets.paper(cell)):
        for scale, factor in ((64, 8), (16, 4), (4, 2), (1, 1)):
            small, small_size = level_spec(spec, scale, size)
            assert small_size == (size[0] // factor, size[1] // factor)
            assert small.cell_size == (cell[0] // factor, cell[1] // factor)
            assert small.grid(*small_size) == spec.grid(*size)
        assert level_spec(spec, 1, size) == (spec, size)


@all_specs
def test_scale_descriptors_are_those_of_averaged_images(spec: HOGSpec) -> None:
    image = torch.cat([photograph(64), photograph(64, "coins")])[..., :48].double()
    result = scale_descriptors(image, spec)
    assert len(result) == 4
    for descriptor, factor in zip(result, (8, 4, 2, 1), strict=True):
        small, _ = level_spec(spec, factor**2, (64, 48))
        assert descriptor.shape == (2, 8, 6, spec.channels)
        mean = image.unfold(2, factor, factor).unfold(3, factor, factor).mean(dim=(4, 5))
        torch.testing.assert_close(descriptor, hog(mean, small))
    assert torch.equal(result[-1], hog(image, spec))
    assert len(scale_descriptors(image, spec, (4, 1))) == 2
    with pytest.raises(ValueError, match="no scale 1/4"):
        scale_descriptors(image[..., :47], spec, (4, 1))


@pytest.mark.parametrize(
    ("preset", "cell", "more"),
    [
        (presets.uoctti, (8, 16), True),
        (presets.uoctti, (8, 8), False),
        (presets.paper, (8, 8), True),
        (presets.paper, (8, 8), False),
        (presets.paper, (16, 8), True),
        (presets.paper, (8, 16), False),
    ],
)
def test_levels_grow_and_report_their_own_distance(
    preset: Any, cell: tuple[int, int], more: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("single_scale", "multiscale"):  # rough histograms will do, and are sooner found
        rough = functools.partial(recover_histograms, max_evaluations=30)
        monkeypatch.setattr(f"nablahog.invert.{module}.recover_histograms", rough)
    spec, size = preset(cell), (4 * cell[0], 3 * cell[1])
    image = photograph(64, "coins")[..., : size[0], -size[1] :]
    given = descriptors(image, spec, more)
    levels = reconstruct_multiscale(given, spec, search=Search(max_evaluations=BUDGET))
    assert [level.scale for level in levels] == [64, 16, 4, 1]
    for i, (level, factor) in enumerate(zip(levels, (8, 4, 2, 1), strict=True)):
        assert level.reconstruction.image.shape == (1, 1, size[0] // factor, size[1] // factor)
        assert level.spec.cell_size == (cell[0] // factor, cell[1] // factor)
        assert level.reconstruction.image.min() >= 0
        assert level.reconstruction.image.max() <= 1
        assert level.reconstruction.evaluations.max() <= (BUDGET if factor == 1 else BUDGET // 4)
        if isinstance(given, list):
            torch.testing.assert_close(level.reconstruction.distance, distance(level, given[i]))
    assert levels[-1].spec == spec
    last = given[-1] if isinstance(given, list) else given
    torch.testing.assert_close(levels[-1].reconstruction.distance, distance(levels[-1], last))
    assert (levels[-1].reconstruction.distance < 0.8).all()


@all_specs
def test_every_level_is_given_the_descriptor_at_the_contrast_of_its_size(spec: HOGSpec) -> None:
    descriptor = hog(photograph(32), spec)
    for level in reconstruct_multiscale(descriptor, spec, search=Search(max_evaluations=BUDGET)):
        # a smaller image of the same contrast has steeper, but fewer gradients
        own = descriptor / level.scale**0.25 if spec.normalizer.fixes_contrast else descriptor
        torch.testing.assert_close(level.reconstruction.distance, distance(level, own))


def test_the_printed_normalisers_scale_is_that_of_a_smooth_image() -> None:
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    image = (0.5 + 0.2 * torch.sin(x / 12) * torch.cos(y / 9)).double()[None, None]
    full, *_ = reversed(scales := scale_descriptors(image, SPECS["paper"], (16, 4, 1)))
    for descriptor, scale in zip(scales, (16, 4, 1), strict=True):
        assert (descriptor.norm() / full.norm()).item() == pytest.approx(scale**-0.25, rel=0.1)


@all_specs
@both_variants
def test_a_photograph_comes_back(spec: HOGSpec, more: bool) -> None:
    image = photograph(64)
    levels = reconstruct_multiscale(
        descriptors(image, spec, more, (16, 4, 1)), spec, scales=(16, 4, 1), search=Search(max_evaluations=60)
    )
    assert levels[-1].reconstruction.distance[0] < 0.35
    if spec.signed:
        assert correlation(levels[-1].reconstruction.image, image) > 0.85
        assert correlation(levels[0].reconstruction.image, avg_pool2d(image, 4)) > 0.8
    for small, large in pairwise(levels):  # each begins where the one before ended
        assert correlation(small.reconstruction.image, avg_pool2d(large.reconstruction.image, 2)) > 0.7


@all_specs
@both_variants
def test_progress_rises_over_all_levels_and_stays_in_the_budget(spec: HOGSpec, more: bool) -> None:
    calls: list[tuple[int, int]] = []
    levels = reconstruct_multiscale(
        descriptors(photograph(32), spec, more),
        spec,
        search=Search(max_evaluations=20),
        progress=lambda *call: calls.append(call),
    )
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert {most for _, most in calls} == {3 * 5 + 20}
    assert done[0] >= 1
    assert done[-1] == 15 + levels[-1].reconstruction.evaluations.max() <= 35


def test_a_flat_image_ends_every_level_early_and_progress_still_rises() -> None:
    calls: list[int] = []
    spec = SPECS["paper"]
    flat = hog(torch.full((1, 1, 32, 32), 0.7), spec)
    levels = reconstruct_multiscale(flat, spec, progress=lambda done, most: calls.append(done))
    assert calls == sorted(set(calls))
    assert all(level.reconstruction.distance.item() == 0 for level in levels)
    assert levels[-1].reconstruction.image.unique().numel() == 1


@pytest.mark.parametrize("name", ["paper", "paper-robust"])
def test_a_level_without_texture_does_not_end_those_after_it(name: str) -> None:
    y, x = torch.meshgrid(torch.arange(32), torch.arange(32), indexing="ij")
    checkers = (0.2 + 0.6 * ((x // 2 + y // 2) % 2))[None, None]  # gray but for the last two levels
    result = reconstruct_multiscale(
        scale_descriptors(checkers, SPECS[name]), SPECS[name], search=Search(max_evaluations=40)
    )
    assert result[-2].reconstruction.distance.item() < 0.9
    assert result[-1].reconstruction.distance.item() < 0.5


@all_specs
@both_variants
def test_scales_of_choice(spec: HOGSpec, more: bool) -> None:
    image = photograph(48)[..., :40]
    levels = reconstruct_multiscale(
        descriptors(image, spec, more, (4, 1)), spec, scales=(4, 1), search=Search(max_evaluations=8)
    )
    assert [level.scale for level in levels] == [4, 1]
    assert [tuple(level.reconstruction.image.shape[2:]) for level in levels] == [(24, 20), (48, 40)]
    assert [level.spec.cell_size for level in levels] == [(4, 4), (8, 8)]
    assert [int(level.reconstruction.evaluations) for level in levels] == [2, 8]


def test_partial_cells_where_the_size_is_given() -> None:
    spec = dataclasses.replace(SPECS["signed"], partial_cells="ceil")
    image = photograph(64)[..., :44, :52]  # 5.5 and 6.5 cells, rounded up
    levels = reconstruct_multiscale(hog(image, spec), spec, (44, 52), scales=(4, 1), search=Search(max_evaluations=8))
    assert levels[-1].reconstruction.image.shape == (1, 1, 44, 52)
    assert levels[0].reconstruction.image.shape == (1, 1, 22, 26)


@pytest.mark.parametrize("name", ["signed", "paper"])
def test_same_seed_same_images(name: str) -> None:
    spec = SPECS[name]
    descriptor = hog(photograph(32), spec)
    first, again, other = (
        reconstruct_multiscale(descriptor, spec, scales=(4, 1), seed=s, search=Search(max_evaluations=8))
        for s in (0, 0, 1)
    )
    for a, b, c in zip(first, again, other, strict=True):
        assert torch.equal(a.reconstruction.image, b.reconstruction.image)
        assert not torch.equal(a.reconstruction.image, c.reconstruction.image)


@pytest.mark.parametrize("name", ["signed", "paper"])
@both_variants
def test_batch_equals_loop(name: str, more: bool) -> None:
    spec = SPECS[name]
    images = torch.cat([photograph(32), photograph(32, "coins")]).double()

    def run(image: Tensor) -> list[Level]:
        return reconstruct_multiscale(descriptors(image, spec, more), spec, search=Search(max_evaluations=BUDGET))

    together = run(images)
    for i in range(2):
        for level, alone in zip(together, run(images[i : i + 1]), strict=True):
            assert level.reconstruction.image.dtype == torch.float64
            torch.testing.assert_close(level.reconstruction.image[i], alone.reconstruction.image[0], atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", ["paper", "paper-robust"])
def test_the_last_level_decides_the_polarity_of_all(name: str) -> None:
    spec = SPECS[name]
    for picture in ("camera", "coins", "coffee"):
        descriptor = hog(photograph(32, picture), spec)
        result, chosen = (
            reconstruct_multiscale(descriptor, spec, scales=(4, 1), search=Search(max_evaluations=BUDGET, polarity=p))
            for p in (False, True)
        )
        assert torch.equal(chosen[-1].reconstruction.image, fix_polarity(result[-1].reconstruction.image))
        turned = not torch.equal(chosen[-1].reconstruction.image, result[-1].reconstruction.image)
        for a, b in zip(result, chosen, strict=True):
            assert torch.equal(b.reconstruction.image, 1 - a.reconstruction.image if turned else a.reconstruction.image)
            torch.testing.assert_close(a.reconstruction.distance, b.reconstruction.distance)


def test_closeness_keeps_levels_together() -> None:
    spec = SPECS["paper"]
    descriptor = hog(photograph(32), spec)

    def agreement(closeness: float) -> float:
        small, large = reconstruct_multiscale(
            descriptor,
            spec,
            scales=(4, 1),
            search=Search(max_evaluations=40, polarity=False),
            objective=Objective(closeness=closeness),
        )
        return correlation(small.reconstruction.image, avg_pool2d(large.reconstruction.image, 2))

    assert agreement(10.0) > agreement(0.0)


@pytest.mark.parametrize("scales", [(), (1, 4), (4, 4), (4, 1, 4), (64, 4, 16, 1)])
def test_scales_must_fall(scales: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="scales must fall"):
        reconstruct_multiscale(torch.zeros(1, 4, 4, 9), SPECS["paper"], scales=scales)


@pytest.mark.parametrize("count", [0, 3, 5])
def test_there_must_be_a_descriptor_for_each_scale(count: int) -> None:
    with pytest.raises(ValueError, match=f"descriptor for each of 4 scales, got {count}"):
        reconstruct_multiscale([torch.zeros(1, 4, 4, 9)] * count, SPECS["paper"])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"scales": (9, 1)}, "multiples of 3"),
        ({"scales": (4, 2, 1)}, "square number"),
        ({"scales": (4, 0)}, "square number.*got 0"),
        ({"image_size": (64, 64)}, r"must have shape \(8, 8, 9\)"),
        ({"image_size": (30, 32)}, "no scale"),
    ],
)
def test_options_out_of_range(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        reconstruct_multiscale(hog(photograph(32), SPECS["paper"]), SPECS["paper"], **options)


@pytest.mark.parametrize(
    ("descriptor", "spec", "error", "says"),
    [
        (torch.zeros(0, 4, 4, 31), presets.uoctti(8), ValueError, "B at least 1"),
        (torch.full((1, 4, 4, 31), torch.nan), presets.uoctti(8), ValueError, "finite"),
        pytest.param(torch.zeros(4, 4, 31), presets.uoctti(8), ValueError, r"shape \(B, rows, cols, channels\)"),
        pytest.param(torch.zeros(1, 4, 4, 9), presets.uoctti(8), ValueError, r"\(4, 4, 31\).*got \(4, 4, 9\)"),
        pytest.param(torch.full((1, 4, 4, 9), torch.nan), SPECS["paper"], ValueError, "finite"),
        pytest.param(torch.zeros(1, 4, 4, 31).long(), presets.uoctti(8), TypeError, "float32 or float64.*int64"),
    ],
    ids=["empty", "nan", "3-d", "channels", "nan-unsigned", "integers"],
)
def test_bad_descriptors_say_what_was_expected(
    descriptor: Tensor, spec: HOGSpec, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        reconstruct_multiscale(descriptor, spec)
