"""reconstruct, as a user calls it."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import HOGSpec, hog, presets, reconstruct
from nablahog.hog import FourBlockNorm
from nablahog.invert import Objective, Search
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.parameterize import low_pass
from nablahog.invert.polarity import fix_polarity
from nablahog.invert.single_scale import LEAST_EVALUATIONS, SHARE_OF_SAMPLES
from nablahog.invert.start import at_contrast
from nablahog.optimize import minimise

from .options import grouped
from .photographs import photograph

SPECS = {
    "uoctti": presets.uoctti(8),
    "uoctti-hard": presets.uoctti(8, vote="hard"),
    "uoctti-rectangular": presets.uoctti((8, 5)),
    "paper": presets.paper(8),
    "paper-robust": presets.paper(8, global_form="robust"),
    "signed-global": dataclasses.replace(presets.paper(8), signed=True, bins=8, partial_cells="ceil"),
}


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


@pytest.mark.parametrize("name", SPECS)
def test_the_returned_image_explains_the_descriptor(name: str) -> None:
    spec = SPECS[name]
    image = photograph(61)
    descriptor = hog(image, spec)
    result = reconstruct(descriptor, spec, image_size=(61, 61), search=Search(max_evaluations=120))
    assert result.image.shape == (1, 1, 61, 61)
    assert result.image.dtype == torch.float32
    assert result.image.min() >= 0
    assert result.image.max() <= 1
    recomputed = (hog(result.image, spec) - descriptor).norm() / descriptor.norm()
    torch.testing.assert_close(result.distance[0], recomputed)
    assert result.distance[0] < (0.5 if spec.vote == "hard" else 0.25)
    assert len(result.stop_reason) == 1
    assert result.history.shape[0] == int(result.evaluations[0]) <= 120
    assert result.history[-1, 0] < result.history[0, 0]
    assert result.seconds > 0


def test_a_photograph_comes_back() -> None:
    spec = presets.uoctti(8)
    images = torch.cat([photograph(96, name) for name in ("camera", "astronaut", "coffee")])
    result = reconstruct(hog(images, spec), spec, search=Search(max_evaluations=150))
    for pre_image, image in zip(result.image, images, strict=True):
        assert correlation(pre_image, image) > 0.85


@pytest.mark.parametrize("name", ["signed-global", "paper"])
def test_same_seed_same_image(name: str) -> None:
    spec = SPECS[name]
    descriptor = hog(photograph(32), spec)
    first, again, other = (
        reconstruct(descriptor, spec, seed=s, search=Search(max_evaluations=30)).image for s in (0, 0, 1)
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("uoctti", {}),
        ("signed-global", {"max_evaluations": 90, "samples": 2}),
        ("signed-global", {"start": photograph(32, "coffee"), "closeness": 1.0}),
        ("paper", {}),
        ("paper", {"expected": photograph(32, "coffee")}),
        ("paper-robust", {"region_signs": False}),
    ],
)
def test_batch_equals_loop(name: str, options: dict[str, Any]) -> None:
    images = torch.cat([photograph(32, name) for name in ("camera", "coins")]).double()
    descriptors = hog(images, SPECS[name])
    own = {k: v.double() if isinstance(v, Tensor) else v for k, v in {"max_evaluations": 25, **options}.items()}
    shared = {k: v.expand(2, -1, -1, -1) if isinstance(v, Tensor) else v for k, v in own.items()}
    together = reconstruct(descriptors, SPECS[name], **grouped(**shared))
    assert together.image.dtype == together.distance.dtype == together.history.dtype == torch.float64
    for i in range(2):
        alone = reconstruct(descriptors[i : i + 1], SPECS[name], **grouped(**own))
        torch.testing.assert_close(together.image[i], alone.image[0], atol=1e-3, rtol=0)
        assert together.evaluations[i] == alone.evaluations[0]


def test_a_batch_spends_what_its_images_alone_would(monkeypatch: pytest.MonkeyPatch) -> None:
    def impatient(name: Any, problem: Any, *given: Any, progress_tolerance: float, **options: Any) -> Any:
        if problem.votes is not None:  # samples end early, each after another number of evaluations
            progress_tolerance = 0.6
        return minimise(name, problem, *given, progress_tolerance=progress_tolerance, **options)

    monkeypatch.setattr("nablahog.invert.search.minimise", impatient)
    spec = SPECS["signed-global"]
    descriptors = hog(torch.cat([photograph(32), photograph(32, "coins")]).double(), spec)
    together = reconstruct(descriptors, spec, search=Search(samples=1, max_evaluations=80))
    alone = [reconstruct(descriptors[i : i + 1], spec, search=Search(samples=1, max_evaluations=80)) for i in range(2)]
    assert together.evaluations.tolist() == [int(a.evaluations) for a in alone]


def test_a_flat_photograph_is_found_exactly() -> None:
    for spec in (presets.uoctti(8), presets.paper(8)):
        result = reconstruct(hog(torch.full((1, 1, 32, 32), 0.7), spec), spec, search=Search(max_evaluations=20))
        assert result.image.unique().numel() == 1
        assert result.distance.item() == 0


@pytest.mark.parametrize("name", ["signed-global", "paper"])
@pytest.mark.parametrize("budget", [2, 3, 5, 10, 90])  # the last one draws two samples
def test_progress_rises_up_to_the_budget(name: str, budget: int) -> None:
    calls: list[tuple[int, int]] = []
    images = torch.cat([photograph(32), torch.full((1, 1, 32, 32), 0.7)])  # a flat one is found at once
    result = reconstruct(
        hog(images, SPECS[name]),
        SPECS[name],
        search=Search(max_evaluations=budget),
        progress=lambda *call: calls.append(call),
    )
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert {most for _, most in calls} == {budget}
    assert done[-1] == result.evaluations.max() <= budget
    assert result.evaluations.min() >= 2
    assert result.history.shape == (done[-1], 2)
    assert torch.isfinite(result.history).all()


@pytest.mark.parametrize("size", [(1, 9), (9, 1), (2, 9), (3, 3)])
@pytest.mark.parametrize("spec", [presets.paper(1), presets.uoctti(2)], ids=["paper", "uoctti"])
def test_images_of_a_few_pixels(size: tuple[int, int], spec: HOGSpec) -> None:
    image = torch.rand(1, 1, *size, generator=torch.Generator().manual_seed(0))
    result = reconstruct(hog(image, spec), spec, image_size=size, search=Search(max_evaluations=20))
    assert torch.isfinite(result.image).all()
    assert torch.isfinite(result.history).all()
    assert torch.isfinite(result.distance).all()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"start": torch.zeros(1, 1, 32, 31)}, r"start must have shape \(1, 1, 32, 32\), got \(1, 1, 32, 31\)"),
        ({"start": torch.zeros(2, 1, 32, 32)}, r"start must have shape \(1, 1, 32, 32\), got \(2, 1, 32, 32\)"),
        ({"expected": torch.zeros(32, 32)}, r"expected must have shape \(1, 1, 32, 32\), got \(32, 32\)"),
        ({"expected": torch.zeros(1, 3, 32, 32)}, r"expected must have shape \(1, 1, 32, 32\), got \(1, 3, 32, 32\)"),
    ],
)
def test_images_of_another_shape(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        reconstruct(torch.rand(1, 4, 4, 9), presets.paper(8), **options)


def test_without_texture_channels() -> None:
    spec = dataclasses.replace(presets.uoctti(8), normalizer=FourBlockNorm(parts=("directed", "undirected")))
    image = photograph(48)
    result = reconstruct(hog(image, spec), spec, search=Search(max_evaluations=60, samples=1))
    assert result.distance.item() < 0.3


@pytest.mark.parametrize("name", ["signed-global", "paper-robust"])
@pytest.mark.parametrize(
    "options",
    [
        {"samples": 1},
        {"max_evaluations": 90, "samples": 2},
        {"closeness": 0.0},
        {"closeness": 3.0},
        {"start": photograph(32, "coffee")},
        {"expected": photograph(32, "coffee")},
        {"start": photograph(32, "coins"), "expected": photograph(32, "coffee")},
        {"region_signs": False},
        {"polarity": False},
        {"smoothness": 0.0},
        {"basis": "pixels"},
    ],
    ids=lambda options: ",".join(f"{k}={v if not isinstance(v, Tensor) else '...'}" for k, v in options.items()),
)
def test_every_option_reports_its_images_distance(name: str, options: dict[str, Any]) -> None:
    spec, descriptor = SPECS[name], hog(photograph(32), SPECS[name])
    result = reconstruct(descriptor, spec, **grouped(**{"max_evaluations": 30, **options}))
    recomputed = (hog(result.image, spec) - descriptor).norm() / descriptor.norm()
    torch.testing.assert_close(result.distance, recomputed.reshape(1))
    assert result.distance < 0.9
    assert result.image.shape == (1, 1, 32, 32)
    assert result.image.min() >= 0
    assert result.image.max() <= 1
    assert len(result.history) == int(result.evaluations)


def test_samples_of_too_few_evaluations_are_not_drawn() -> None:
    spec = SPECS["signed-global"]
    descriptor = hog(photograph(32), spec)
    enough_for_two = -(-2 * LEAST_EVALUATIONS // SHARE_OF_SAMPLES)

    def images(budget: float) -> list[Tensor]:
        return [
            reconstruct(descriptor, spec, search=Search(max_evaluations=int(budget), samples=s)).image
            for s in (1, 2, 6)
        ]

    one, two, six = images(enough_for_two - 2)
    assert torch.equal(one, two)
    assert torch.equal(one, six)
    one, two, six = images(enough_for_two)
    assert not torch.equal(one, two)
    assert torch.equal(two, six)


def test_what_samples_agree_on_depends_less_on_the_seed() -> None:
    spec = SPECS["signed-global"]
    descriptor = hog(photograph(32), spec)

    def agreement(samples: int) -> float:
        return correlation(
            *(
                reconstruct(descriptor, spec, search=Search(max_evaluations=120, samples=samples), seed=s).image
                for s in (0, 1)
            )
        )

    assert agreement(3) > agreement(1)


@pytest.mark.parametrize("name", ["signed-global", "paper"])
def test_what_is_expected_is_where_the_search_begins_and_stays_close_to(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*given: Any) -> Tensor:
        raise AssertionError("no start but the expected is needed")

    monkeypatch.setattr("nablahog.invert.single_scale.starting_images", never)
    monkeypatch.setattr("nablahog.invert.single_scale.noise", never)
    spec = SPECS[name]
    descriptor = hog(photograph(48).double(), spec)
    expected = low_pass(photograph(48).double(), 3.0)
    weak, strong = (
        reconstruct(
            descriptor,
            spec,
            search=Search(max_evaluations=40, polarity=False),
            expected=expected,
            objective=Objective(closeness=c),
        )
        for c in (0.0, 10.0)
    )
    begun = at_contrast(expected, recover_histograms(descriptor, spec), spec)
    torch.testing.assert_close(weak.history[0, 0], (hog(begun, spec) - descriptor).norm() / descriptor.norm())
    assert correlation(strong.image, expected) > correlation(weak.image, expected)
    assert strong.distance > weak.distance
    for result in (weak, strong):
        assert correlation(low_pass(result.image, 3.0), expected) > 0.95
        assert correlation(result.image, photograph(48)) > correlation(expected, photograph(48))


@pytest.mark.parametrize("name", ["signed-global", "paper"])
def test_a_start_is_where_samples_begin(name: str) -> None:
    spec, image = SPECS[name], photograph(48)
    result = reconstruct(hog(image, spec), spec, search=Search(max_evaluations=40, polarity=False), start=image)
    assert correlation(result.image, image) > 0.97
    negative = reconstruct(hog(image, spec), spec, search=Search(max_evaluations=40, polarity=False), start=1 - image)
    assert (correlation(negative.image, image) < -0.97) == (not spec.signed)


@pytest.mark.parametrize("name", ["signed-global", "paper", "paper-robust"])
@pytest.mark.parametrize("which", ["start", "expected"])
def test_the_contrast_of_given_images_does_not_matter(name: str, which: str) -> None:
    spec, image = SPECS[name], photograph(32, "coffee").double()
    descriptor = hog(photograph(32).double(), spec)
    mean = image.mean()
    full, half = (
        reconstruct(
            descriptor, spec, search=Search(max_evaluations=25), **{which: mean + contrast * (image - mean)}
        ).image
        for contrast in (1.0, 0.5)
    )
    torch.testing.assert_close(full, half, atol=1e-6, rtol=0)


def test_polarity_chooses_between_an_image_and_its_negative() -> None:
    for name in ("camera", "coins", "coffee"):
        descriptor = hog(photograph(32, name), SPECS["paper"])
        result = reconstruct(descriptor, SPECS["paper"], search=Search(max_evaluations=30, polarity=False))
        chosen = reconstruct(descriptor, SPECS["paper"], search=Search(max_evaluations=30))
        assert torch.equal(chosen.image, result.image) or torch.equal(chosen.image, 1 - result.image)
        assert torch.equal(chosen.image, fix_polarity(result.image))
        torch.testing.assert_close(chosen.distance, result.distance)
        assert torch.equal(chosen.history, result.history)


def test_polarity_of_a_signed_descriptor_is_known() -> None:
    descriptor = hog(1 - photograph(32), SPECS["signed-global"])
    result, chosen = (
        reconstruct(descriptor, SPECS["signed-global"], search=Search(max_evaluations=20, polarity=p)).image
        for p in (False, True)
    )
    assert torch.equal(result, chosen)


def test_without_region_signs_the_search_begins_with_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    spec, descriptor = SPECS["paper"], hog(photograph(32), SPECS["paper"])
    given = reconstruct(descriptor, spec, search=Search(max_evaluations=40)).image

    def never(*given: Any) -> Tensor:
        raise AssertionError("no signs are needed")

    monkeypatch.setattr("nablahog.invert.start.expected_cells", never)
    first, again, other = (
        reconstruct(descriptor, spec, search=Search(max_evaluations=40, region_signs=False), seed=s) for s in (0, 0, 1)
    )
    assert torch.equal(first.image, again.image)
    assert abs(correlation(first.image, other.image)) < 0.9  # noise decides the signs
    assert not torch.equal(first.image, given)
    assert first.distance < 0.25


def test_pixels_are_a_basis_too() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(64), spec)
    result = reconstruct(descriptor, spec, search=Search(basis="pixels", max_evaluations=60))
    assert result.distance[0] < 0.6


def test_smoothness_makes_neighbours_agree() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(48), spec)
    rough, smooth = (
        reconstruct(descriptor, spec, objective=Objective(smoothness=w), search=Search(max_evaluations=60)).image
        for w in (0.0, 0.3)
    )

    def variation(image: Tensor) -> Tensor:
        return image.diff(dim=-1).abs().mean() + image.diff(dim=-2).abs().mean()

    assert variation(smooth) < variation(rough)


def test_the_descriptor_carries_no_gradient_and_is_not_changed() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(32), spec).requires_grad_()
    before = descriptor.detach().clone()
    assert not reconstruct(descriptor, spec, search=Search(max_evaluations=5)).image.requires_grad
    assert torch.equal(descriptor, before)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cpu_and_cuda_start_alike() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(64), spec).double()
    cpu, cuda = (
        reconstruct(descriptor.to(d), spec, search=Search(max_evaluations=15)).image.cpu() for d in ("cpu", "cuda")
    )
    torch.testing.assert_close(cpu, cuda, atol=1e-3, rtol=0)


@pytest.mark.parametrize(
    ("descriptor", "spec", "size", "error", "says"),
    [
        (
            torch.zeros(16, 16, 31),
            presets.uoctti(),
            None,
            ValueError,
            r"\(B, rows, cols, channels\).*got \(16, 16, 31\)",
        ),
        (torch.zeros(0, 16, 16, 31), presets.uoctti(), None, ValueError, "B at least 1"),
        (torch.zeros(1, 4, 4, 9), presets.uoctti(), None, ValueError, r"\(4, 4, 31\).*got \(4, 4, 9\)"),
        (torch.zeros(1, 4, 4, 31), presets.uoctti(), (64, 64), ValueError, r"64x64.*\(8, 8, 31\)"),
        (torch.zeros(1, 4, 4, 31).long(), presets.uoctti(), None, TypeError, "float32 or float64.*int64"),
        ([1.0], presets.uoctti(), None, TypeError, "list"),
        (torch.full((1, 4, 4, 31), torch.nan), presets.uoctti(), None, ValueError, "finite"),
        (torch.full((1, 4, 4, 9), torch.inf), presets.paper(), None, ValueError, "finite"),
        (torch.zeros(1, 1, 1, 9), presets.paper(), (4, 4), ValueError, "at least one cell"),
    ],
)
def test_bad_input_says_what_was_expected(
    descriptor: Tensor, spec: HOGSpec, size: tuple[int, int] | None, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        reconstruct(descriptor, spec, image_size=size)
