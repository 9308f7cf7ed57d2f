"""reconstruct, as a user calls it: results, options, quality, arrays, and watching a search."""

from __future__ import annotations

import base64
import dataclasses
import io
import itertools
import os
import re
import time
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import PIL.Image
import pytest
import torch
from torch import Tensor

from nablahog import HOGSpec, hog, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import AsPublished, Iterate, Objective, Reconstruction, Search
from nablahog.invert.arguments import check_descriptor, find_quality
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.prior.terms import GrayRange
from nablahog.invert.reconstruction import find_negatives, negate
from nablahog.invert.search import LEAST_EVALUATIONS, SHARE_OF_SAMPLES
from nablahog.invert.starts import match_contrast
from nablahog.invert.unknowns import low_pass
from nablahog.metrics import cross_correlation

from .photographs import correlation, photograph

UOCTTI, PAPER = presets.uoctti(8), presets.paper(8)
SPECS = {
    "uoctti": UOCTTI,
    "uoctti-hard": presets.uoctti(8, vote="hard"),
    "uoctti-rectangular": presets.uoctti((8, 5)),
    "paper": PAPER,
    "paper-robust": presets.paper(8, global_form="robust"),
    "signed-global": dataclasses.replace(presets.paper(8), signed=True, bins=8, partial_cells="ceil"),
}
BOTH = pytest.mark.parametrize("name", ["signed-global", "paper"])


@pytest.mark.parametrize("name", SPECS)
def test_the_returned_image_explains_the_descriptor(name: str) -> None:
    spec, image = SPECS[name], photograph(61)
    descriptor = hog(image, spec)
    began = time.perf_counter()
    result = reconstruct(descriptor, spec, image_size=(61, 61), search=Search(max_evaluations=120), prior=None)
    assert 0 < result.seconds < time.perf_counter() - began
    assert result.image.shape == (1, 1, 61, 61)
    assert result.image.dtype == torch.float32
    assert 0 <= result.image.min() <= result.image.max() <= 1
    torch.testing.assert_close(result.distance[0], (hog(result.image, spec) - descriptor).norm() / descriptor.norm())
    assert result.distance[0] < (0.5 if spec.vote == "hard" else 0.25)
    assert result.history.shape[0] == int(result.evaluations[0]) <= 120
    assert result.history[-1, 0] < result.history[0, 0]


@pytest.mark.slow
def test_photographs_come_back_and_better_the_more_is_spent() -> None:
    images = torch.cat([photograph(64, name) for name in ("camera", "astronaut", "coffee")])
    descriptors = hog(images, UOCTTI)
    best, fast = (reconstruct(descriptors, UOCTTI, quality=quality, prior=None) for quality in ("best", "fast"))
    assert torch.equal(reconstruct(descriptors, UOCTTI, prior=None).image, best.image)
    assert (fast.evaluations <= find_quality("fast").evaluations).all()
    assert (fast.evaluations * 5 < best.evaluations).all()
    assert (best.distance < fast.distance).all()
    of_best, of_fast = (
        [cross_correlation(a[0], b[0]) for a, b in zip(result.image, images, strict=True)] for result in (best, fast)
    )
    assert sum(of_best) > sum(of_fast)
    assert sum(of_fast) / 3 > 0.76  # the paper's mean over its own photographs


@pytest.mark.parametrize(
    ("name", "search", "given"),
    [
        ("uoctti", Search(max_evaluations=25), None),
        ("signed-global", Search(max_evaluations=90, samples=2), None),
        ("signed-global", Search(max_evaluations=25), "start"),
        ("paper", Search(max_evaluations=25), None),
        ("paper", Search(max_evaluations=25), "expected"),
    ],
)
def test_batch_equals_loop(name: str, search: Search, given: str | None) -> None:
    images = torch.cat([photograph(32, name) for name in ("camera", "coins")]).double()
    descriptors, near = hog(images, SPECS[name]), photograph(32, "coffee").double()

    def run(part: Tensor) -> Reconstruction:
        more: dict[str, Any] = {given: near.expand(len(part), -1, -1, -1)} if given else {}
        return reconstruct(part, SPECS[name], search=search, **more, prior=None)

    together, *alone = map(run, (descriptors, descriptors[:1], descriptors[1:]))
    assert together.image.dtype == together.distance.dtype == together.history.dtype == torch.float64
    assert torch.equal(together.image, torch.cat([one.image for one in alone]))
    assert together.evaluations.tolist() == [int(one.evaluations) for one in alone]


@pytest.mark.slow
@pytest.mark.parametrize("spec", [UOCTTI, PAPER, presets.aubry()], ids=lambda spec: spec.name)
def test_batch_equals_loop_with_learned_priors(spec: HOGSpec) -> None:
    """To the last bit: searches enlarge differences in rounding to other images, or to negatives."""
    images = torch.cat([photograph(64, name) for name in ("camera", "coins")])[..., :61, :53]
    descriptors, few = hog(images, spec), Search(max_evaluations=15)
    together, *alone = (
        reconstruct(part, spec, (61, 53), search=few) for part in (descriptors, descriptors[:1], descriptors[1:])
    )
    assert torch.equal(together.image, torch.cat([single.image for single in alone]))


@BOTH
@pytest.mark.parametrize("budget", [2, 3, 10, 90])  # the last one draws two samples
def test_progress_rises_up_to_the_budget(name: str, budget: int) -> None:
    calls: list[tuple[int, int]] = []
    images = torch.cat([photograph(32), torch.full((1, 1, 32, 32), 0.7)])  # a flat one is found at once
    options: dict[str, Any] = {"search": Search(max_evaluations=budget), "progress": lambda *call: calls.append(call)}
    result = reconstruct(hog(images, SPECS[name]), SPECS[name], **options, prior=None)
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert {most for _, most in calls} == {budget}
    assert done[-1] == result.evaluations.max() <= budget
    assert result.evaluations.min() >= 2
    assert result.history.shape == (done[-1], 2)
    assert result.image[1].unique().numel() == 1
    assert result.distance[1] == 0


@pytest.mark.parametrize("size", [(1, 9), (9, 1), (3, 3)])
@pytest.mark.parametrize("spec", [presets.paper(1), presets.uoctti(2)], ids=["paper", "uoctti"])
def test_images_of_a_few_pixels(size: tuple[int, int], spec: HOGSpec) -> None:
    image = torch.rand(1, 1, *size, generator=torch.Generator().manual_seed(0))
    result = reconstruct(hog(image, spec), spec, image_size=size, search=Search(max_evaluations=20), prior=None)
    assert torch.isfinite(result.image).all()
    assert torch.isfinite(result.history).all()


@pytest.mark.slow
def test_samples_need_evaluations_and_agree_on_what_the_seed_does_not_decide() -> None:
    spec = SPECS["signed-global"]
    descriptor = hog(photograph(32), spec)
    enough_for_two = int(-(-2 * LEAST_EVALUATIONS // SHARE_OF_SAMPLES))

    def images(budget: int, samples: tuple[int, ...], seed: int = 0) -> list[Tensor]:
        searches = [Search(max_evaluations=budget, samples=count) for count in samples]
        return [reconstruct(descriptor, spec, search=search, seed=seed, prior=None).image for search in searches]

    one, six = images(enough_for_two - 2, (1, 6))
    assert torch.equal(one, six)
    one, two, six = images(enough_for_two, (1, 2, 6))
    assert not torch.equal(one, two)
    assert torch.equal(two, six)
    (one, three), (other_one, other_three) = (images(120, (1, 3), seed) for seed in (0, 1))
    assert correlation(three, other_three) > correlation(one, other_one)


@BOTH
def test_the_search_begins_at_the_expected_image_and_stays_close_to_it(name: str) -> None:
    spec, few = SPECS[name], Search(max_evaluations=40)
    descriptor = hog(photograph(48).double(), spec)
    expected = low_pass(photograph(48).double(), 3.0)
    weak, strong = (
        reconstruct(descriptor, spec, search=few, expected=expected, objective=Objective(closeness=c))
        for c in (0.0, 10.0)
    )
    begun = match_contrast(expected, recover_histograms(descriptor, spec), spec)
    torch.testing.assert_close(weak.history[0, 0], (hog(begun, spec) - descriptor).norm() / descriptor.norm())
    assert strong.distance > weak.distance
    for result in (weak, strong):
        assert abs(correlation(low_pass(result.image, 3.0), expected)) > 0.95
    assert abs(correlation(strong.image, expected)) > abs(correlation(weak.image, expected))


@BOTH
@pytest.mark.parametrize("which", ["start", "expected"])
def test_given_images_guide_the_search_at_any_contrast(name: str, which: str) -> None:
    spec, image, few = SPECS[name], photograph(48).double(), Search(max_evaluations=40)
    descriptor = hog(image, spec)
    full, half = (
        reconstruct(descriptor, spec, search=few, **{which: 0.5 + contrast * (image - 0.5)}, prior=None).image
        for contrast in (1.0, 0.5)
    )
    torch.testing.assert_close(full, half, atol=1e-6, rtol=0)
    assert abs(correlation(full, image)) > 0.97
    negative = reconstruct(descriptor, spec, search=few, **{which: 1 - image}, prior=None).image
    assert (abs(correlation(negative, image)) > 0.97) == (not spec.signed)


@pytest.mark.slow
def test_of_an_unsigned_image_and_its_negative_the_likelier_is_returned() -> None:
    def invert(image: Tensor, spec: HOGSpec, budget: int) -> Tensor:
        return reconstruct(hog(image, spec), spec, search=Search(max_evaluations=budget), prior=None).image

    for name in ("camera", "coins", "coffee"):
        image = invert(photograph(32, name), PAPER, 30)
        assert torch.equal(image, negate(image, find_negatives(image)[0]))
    for name in ("signed-global", "paper"):  # a signed descriptor knows
        results = [invert(each, SPECS[name], 60) for each in (photograph(32), 1 - photograph(32))]
        assert (correlation(*results) < 0) == (name == "signed-global")


def test_the_descriptor_carries_no_gradient_and_is_not_changed() -> None:
    descriptor = hog(photograph(32), UOCTTI).requires_grad_()
    before = descriptor.detach().clone()
    assert not reconstruct(descriptor, UOCTTI, search=Search(max_evaluations=5), prior=None).image.requires_grad
    assert torch.equal(descriptor, before)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cpu_and_cuda_start_alike() -> None:
    descriptor, few = hog(photograph(64), UOCTTI).double(), Search(max_evaluations=15)
    cpu, cuda = (reconstruct(descriptor.to(d), UOCTTI, search=few, prior=None).image.cpu() for d in ("cpu", "cuda"))
    torch.testing.assert_close(cpu, cuda, atol=1e-3, rtol=0)


def test_arrays_have_arrays_as_pre_images_and_one_descriptor_has_no_batch() -> None:
    descriptors = hog(np.random.default_rng(0).random((2, 32, 24, 1), np.float32), UOCTTI)
    few, start = Search(max_evaluations=10), np.random.default_rng(1).random((32, 24), np.float32)
    one = reconstruct(descriptors[0], UOCTTI, start=start, search=few, prior=None)
    batch = reconstruct(torch.from_numpy(descriptors[:1]), UOCTTI, start=start, search=few, prior=None)
    assert (one.image.shape, batch.image.shape) == ((32, 24), (1, 1, 32, 24))
    np.testing.assert_array_equal(one.image, batch.image[0, 0].numpy())
    for name in ("distance", "history", "evaluations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(batch, name)[..., 0].numpy())
    levels = reconstruct_multiscale(descriptors[0], UOCTTI, scales=(4, 1), search=few, prior=None)
    assert [level.reconstruction.image.shape for level in levels] == [(16, 12), (32, 24)]


def test_a_result_shows_its_figures_and_in_a_notebook_its_images() -> None:
    descriptor, few = hog(torch.rand(5, 1, 16, 16), presets.uoctti()), Search(max_evaluations=5)
    result = reconstruct(descriptor, "uoctti", search=few, prior=None)
    shown = r"<Reconstruction image 5x1x16x16, distance ([\d.e-]+, ){4}…, [\w ,]+, \d+\.\d s>"
    assert re.fullmatch(shown, repr(result))
    assert "…" not in repr(reconstruct(descriptor[:4], "uoctti", search=few, prior=None))
    page = result._repr_html_()
    assert page.count("<img ") == 4
    png = PIL.Image.open(io.BytesIO(base64.b64decode(page.split("base64,")[1].split('"')[0])))
    np.testing.assert_array_equal(np.asarray(png), (255 * result.image[0, 0]).round().byte().numpy())


def test_a_result_is_saved_by_the_ending(tmp_path: Path) -> None:
    descriptor, few = hog(torch.rand(2, 1, 16, 16), presets.uoctti()), Search(max_evaluations=5)
    batch, single = (reconstruct(each, "uoctti", search=few) for each in (descriptor, descriptor[0].numpy()))
    batch.save(tmp_path / "batch.png")
    single.save(str(tmp_path / "one.tif"))
    assert sorted(os.listdir(tmp_path)) == ["batch_0.png", "batch_1.png", "one.tif"]
    for name, image, kind in (("batch_1.png", batch.image[1, 0], "PNG"), ("one.tif", single.image, "TIFF")):
        stored = PIL.Image.open(tmp_path / name)
        assert stored.format == kind
        np.testing.assert_array_equal(np.asarray(stored), (255 * torch.as_tensor(image)).round().byte().numpy())
    for wrong in ("one", "one.txt"):
        with pytest.raises(ValueError, match="expected the ending of an image file"):
            single.save(tmp_path / wrong)
    assert len(os.listdir(tmp_path)) == 3


ZEROS = torch.zeros(1, 4, 4, 31)


def test_refused_input() -> None:
    wrong: list[tuple[Any, str, dict[str, Any], str]] = [
        (ZEROS[0].repeat(4, 4, 1), "uoctti", {}, r"\(B, rows, cols, channels\).*got \(16, 16, 31\)"),
        (np.zeros(15876), "skimage", {}, r"got \(15876,\).*from_layout"),
        (torch.zeros(1, 4, 4, 9), "uoctti", {}, r"\(4, 4, 31\).*got \(4, 4, 9\)"),
        (ZEROS, "uoctti", {"image_size": (64, 64)}, r"64x64.*\(8, 8, 31\)"),
        (torch.zeros(1, 6, 4, 31), "uoctti", {"image_size": (32, 48)}, "height, width"),
        (torch.full((1, 4, 4, 9), 1e30), "paper", {}, r"at most 1e\+06 in magnitude, got 1e\+30"),
        (ZEROS, "uoctti", {"start": torch.zeros(1, 1, 32, 31)}, "start must have shape"),
        (ZEROS, "uoctti", {"quality": "good"}, "quality must be one of"),
        (ZEROS, "uoctti", {"method": "publisched"}, "method must be"),
    ]
    for descriptor, spec, options, says in wrong:
        with pytest.raises(ValueError, match=says):
            reconstruct(descriptor, spec, **options, prior=None)


def test_default_budgets() -> None:
    """Evaluations with samples, without, and with a signed prior; and samples."""
    assert find_quality("best")[:4] == (660, 480, 200, 4)
    assert find_quality("fast")[:4] == (80, 80, 80, 2)


def test_the_largest_entries() -> None:
    assert check_descriptor(torch.full((1, 4, 4, 9), 1e6), PAPER, None) == (32, 32)


def test_options_out_of_range() -> None:
    wrong: list[tuple[type[Any], dict[str, Any], str]] = [
        (Search, {"minimiser": "newton"}, "minimiser must be one of"),
        (Search, {"max_evaluations": 1}, "max_evaluations must be an integer of at least 2"),
        (Search, {"samples": 0}, "samples must be an integer of at least 1"),
        (Objective, {"smoothness": -1.0}, "smoothness must be a finite number of at least 0"),
        (Objective, {"closeness": float("nan")}, "closeness must be a finite number"),
        (Objective, {"priors": [0.1]}, "priors must be a list of Prior"),
        (Objective, {"priors": GrayRange(0.1)}, "priors must be a list of Prior"),
        (AsPublished, {"smoothness": 0.0}, "smoothness must be a finite number"),
        (AsPublished, {"iterations": 0}, "iterations must be an integer of at least 1"),
        (AsPublished, {"max_evaluations": 1}, "max_evaluations must be an integer of at least 2"),
    ]
    for group, options, says in wrong:
        with pytest.raises((TypeError, ValueError), match=says):
            group(**options)


# --- watching


METHODS: dict[str, dict[str, Any]] = {"default": {"quality": "fast"}, "paper": {"method": AsPublished(iterations=3)}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec", [UOCTTI, presets.opencv(win_size=(32, 32), nbins=18, signed=True)], ids=["uoctti", "roots of images"]
)
@pytest.mark.parametrize("method", METHODS)
def test_watching_changes_nothing(spec: HOGSpec, method: str) -> None:
    seen: list[tuple[Tensor, Tensor]] = []
    descriptors = hog(torch.rand(2, 1, 32, 32, generator=torch.Generator().manual_seed(0)), spec)

    def watch(iterate: Iterate) -> None:
        seen.append((iterate.image, iterate.evaluations.clone()))

    watched = reconstruct(descriptors, spec, (32, 32), watch=watch, **METHODS[method], prior=None)
    assert torch.equal(watched.image, reconstruct(descriptors, spec, (32, 32), **METHODS[method], prior=None).image)
    assert all(image.shape == (2, 1, 32, 32) and 0 <= image.min() <= image.max() <= 1 for image, _ in seen)
    assert all((after >= before).all() for (_, before), (_, after) in itertools.pairwise(seen))
    assert (seen[-1][0] - watched.image).abs().mean() < 0.05


@pytest.mark.parametrize("method", METHODS)
def test_an_exception_ends_the_search(method: str) -> None:
    watch = Mock(side_effect=[None, InterruptedError])
    with pytest.raises(InterruptedError):
        reconstruct(hog(torch.rand(1, 1, 32, 32), UOCTTI), UOCTTI, watch=watch, **METHODS[method], prior=None)
    assert watch.call_count == 2
