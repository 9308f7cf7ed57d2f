"""The minimisations of a reconstruction, by any minimiser: what they record, in a batch, and on a device."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.hog import HOGSpec
from nablahog.invert import Objective, Search, default_prior, preimage, search
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.prior.terms import GrayRange, RelativeSmoothness
from nablahog.invert.search import PreimageSearch
from nablahog.invert.starts import noise
from nablahog.invert.unknowns import FlatRegions
from nablahog.optimize import MINIMISERS, Minimiser, Minimum, StopReason
from nablahog.optimize.lbfgs import LbfgsSearch

from ..waiting import WithoutWaiting
from .photographs import photograph

SPEC, UOCTTI = presets.paper(8), presets.uoctti(8)
IMAGES = torch.cat([photograph(32), photograph(32, "coins"), torch.full((1, 1, 32, 32), 0.7)]).double()
DESCRIPTORS = hog(IMAGES, SPEC)
VOTES = recover_histograms(DESCRIPTORS, SPEC)
every_minimiser = pytest.mark.parametrize("minimiser", MINIMISERS)


def account(
    descriptors: Tensor = DESCRIPTORS,
    budget: int = 100,
    minimiser: Minimiser = "lbfgs",
    progress: Callable[[int, int], None] | None = None,
) -> PreimageSearch:
    return PreimageSearch(descriptors, SPEC, (32, 32), [RelativeSmoothness(0.02)], minimiser, budget, progress)


def history(made: PreimageSearch) -> Tensor:
    return made.history.fill(int(made.evaluations.max()))


def starts(count: int) -> Tensor:
    return 0.5 + noise(DESCRIPTORS, 32, 32, count, seed=0).expand(3, -1, -1, -1, -1)


def relative(images: Tensor) -> Tensor:
    """Distances (B, K) of images (B, K, 1, H, W)."""
    own = hog(images.flatten(0, 1), SPEC).view(*images.shape[:2], *DESCRIPTORS.shape[1:])
    return (own - DESCRIPTORS.unsqueeze(1)).flatten(2).norm(dim=2) / DESCRIPTORS.flatten(1).norm(dim=1).unsqueeze(1)


def test_evaluations_of_all_images_of_a_descriptor_add_up() -> None:
    made = account()
    result = made.match(starts(3), VOTES, 12)
    assert result.shape == (3, 3, 1, 32, 32)
    # the flat image's start is flat already: one evaluation shows it, another that nothing moves
    assert made.evaluations[:2].tolist() == [36, 36]
    assert int(made.evaluations[2]) in (3, 6)
    assert made.remaining_evaluations() == 64
    made.match(result.mean(dim=1, keepdim=True), None, made.remaining_evaluations())
    assert made.evaluations[:2].tolist() == [100, 100]
    assert history(made).shape == (100, 3)
    assert made.remaining_evaluations() == 1  # never nothing, as a minimiser cannot spend nothing


@every_minimiser
def test_the_account_of_any_minimiser(minimiser: Minimiser) -> None:
    calls: list[tuple[int, int]] = []
    made = account(budget=60, minimiser=minimiser, progress=lambda *call: calls.append(call))
    result = made.match(starts(2), VOTES, 20)
    assert (made.evaluations <= 40).all()
    assert (made.evaluations[:2] > 20).all()
    made.match(result[:, :1], None, made.remaining_evaluations(), IMAGES, 0.1)
    assert (made.evaluations <= 60).all()
    assert torch.isfinite(history(made)).all()
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert done[-1] <= int(made.evaluations.max())
    assert {call[1] for call in calls} == {60}


def test_history_begins_with_the_starts_distance_and_counts_one_image_after_the_other() -> None:
    begin, made = starts(2), account()
    made.match(begin, VOTES, 5)
    distances = history(made)
    torch.testing.assert_close(distances[0, :2], relative(begin)[:2, 0])  # a flat descriptor makes its start flat
    assert len(distances) == 10
    other = account()
    other.match(begin[:, 1:], VOTES, 5)
    torch.testing.assert_close(distances[-1, :2], history(other)[-1, :2])


def test_the_result_is_closer_than_the_start_and_not_far_from_the_expected_image() -> None:
    begin = starts(1)
    free = account().match(begin, None, 30)
    assert (relative(free)[:2] < 0.5 * relative(begin)[:2]).all()
    kept = account().match(begin, None, 30, IMAGES[[1, 0, 2]], 10.0)

    def away(images: Tensor) -> Tensor:
        difference = images[:2, 0] - IMAGES[[1, 0]]
        return (difference - difference.mean(dim=(2, 3), keepdim=True)).flatten(1).norm(dim=1)

    assert (away(kept) < 0.3 * away(free)).all()
    assert (relative(kept)[:2] > relative(free)[:2]).all()


@pytest.mark.slow
@every_minimiser
def test_reconstruct_by_any_minimiser(minimiser: Minimiser) -> None:
    """Two samples and a flat image, alone as in a batch."""
    spec = dataclasses.replace(SPEC, signed=True, bins=18)
    descriptors = hog(IMAGES, spec)
    options = {"search": Search(minimiser, max_evaluations=120, samples=2), "objective": Objective(closeness=0.1)}
    result = reconstruct(descriptors, spec, **options, prior=None)
    assert result.evaluations.max() <= 120
    assert result.history.shape == (int(result.evaluations.max()), 3)
    assert (result.history[-1, :2] < 0.75 * result.history[0, :2]).all()
    assert result.distance[2] == 0
    alone = reconstruct(descriptors[:1], spec, **options, prior=None)
    torch.testing.assert_close(alone.image, result.image[:1], atol=1e-3, rtol=0)
    assert alone.evaluations[0] == result.evaluations[0]


@pytest.mark.slow
@every_minimiser
def test_priors_and_smoothness_make_neighbours_agree(minimiser: Minimiser) -> None:
    descriptor, few = hog(photograph(48), SPEC), Search(minimiser, max_evaluations=60)

    def variation(target: Objective) -> float:
        image = reconstruct(descriptor, SPEC, search=few, objective=target, prior=None).image
        return float(image.diff(dim=-1).abs().mean() + image.diff(dim=-2).abs().mean())

    without = variation(Objective(smoothness=0))
    assert variation(Objective(smoothness=0.3)) < without
    assert variation(Objective(smoothness=0, priors=[RelativeSmoothness(0.3)])) < without


# --- on a device: rounds that wait for nothing, results that are those of a CPU


def test_results_on_a_device_are_those_on_a_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    first = torch.cat([starts(1), torch.full_like(starts(1), 0.5)], dim=1)  # the flat ones end at once

    def run() -> tuple[PreimageSearch, Tensor]:
        made = account(budget=60)
        mean = made.match(first, VOTES, 18).mean(dim=1)
        return made, made.match(mean.unsqueeze(1), None, made.remaining_evaluations(), mean, 1.0)

    on_cpu, its_images = run()
    monkeypatch.setattr("nablahog.optimize.problems.dropped_at_once", lambda like: False)
    on_device, images_there = run()
    for made in (on_cpu, on_device):
        assert made.evaluations[2] < made.evaluations[:2].min()  # the flat image ends, and others go on
    torch.testing.assert_close(images_there, its_images, atol=1e-4, rtol=0)
    torch.testing.assert_close(history(on_device), history(on_cpu), atol=1e-4, rtol=0)


def test_rounds_of_a_search_ask_for_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """HOG itself is replaced by what it is on a GPU, kernels that wait for nothing; everything else runs."""
    image = torch.rand(2, 1, 32, 32, generator=torch.Generator().manual_seed(0))
    image[:, :, :24] = 0.5
    descriptor = hog(image, UOCTTI)
    regions = FlatRegions(descriptor.repeat_interleave(2, 0), UOCTTI, 32, 32)
    assert len(regions.sizes) > 1
    regions.regions, regions.sizes = regions.regions.to("meta"), regions.sizes.to("meta")
    votes = recover_histograms(descriptor, UOCTTI)

    def to_cells(images: Tensor, spec: HOGSpec) -> Tensor:
        return images.mean(dim=(2, 3), keepdim=True).expand(len(images), *votes.shape[1:]) + 0.0

    def normalize(cells: Tensor, spec: HOGSpec) -> Tensor:
        return cells[:, :1].expand(-1, descriptor.shape[3], *descriptor.shape[1:3]) + 0.0

    monkeypatch.setattr(search, "FlatRegions", lambda *args: regions)
    monkeypatch.setattr(search, "histograms", to_cells)
    monkeypatch.setattr(search, "normalize", normalize)
    seen, reports = [], []

    def minimise(problem: Any, start: Tensor, watch: Any, **options: Any) -> Minimum:
        run = LbfgsSearch(problem, start, 6, 1.0, watch)  # also warms up what is kept on the device
        with WithoutWaiting():
            for _ in range(3):
                run.advance()
                run.end(0.0, 1e-3)
        reason = [StopReason.BUDGET] * len(start)
        return Minimum(run.vectors.x, run.state.values, run.running.evaluations, reason, run.state.values.unsqueeze(0))

    monkeypatch.setitem(search.MINIMISERS, "lbfgs", minimise)
    terms, report = [RelativeSmoothness(0.02), GrayRange(10.0)], lambda done, most: reports.append(done)
    made = PreimageSearch(descriptor.to("meta"), UOCTTI, (32, 32), terms, "lbfgs", 100, report, seen.append)
    start = torch.rand(2, 2, 1, 32, 32, device="meta")
    images = made.match(start, votes.to("meta"), 25, start.mean(dim=1), 0.3)
    assert images.shape == start.shape
    assert len(seen) == 4
    assert not reports  # the first would be after ten


@pytest.mark.parametrize("learned", [False, True], ids=["no prior", "prior"])
def test_batches_are_split_by_the_memory_that_is_free(learned: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {"search": Search(max_evaluations=4), "prior": default_prior(SPEC) if learned else None}
    together = reconstruct(DESCRIPTORS, SPEC, **options)
    asked: list[float] = []

    def memory_for(device: torch.device, on_cpu: int, share: float) -> int:
        asked.append(share)
        return on_cpu // 2**14

    monkeypatch.setattr(preimage, "memory_for", memory_for)
    monkeypatch.setattr(search, "memory_for", memory_for)
    parts: list[slice] = []
    calls: list[tuple[int, int]] = []
    options |= {"watch": lambda now: parts.append(now.descriptors), "progress": lambda *call: calls.append(call)}
    apart = reconstruct(DESCRIPTORS, SPEC, **options)
    assert {(part.start, part.stop) for part in parts} == {(0, 1), (1, 2), (2, 3)}
    for name in ("image", "distance", "history"):
        error = 1e-5 if learned else 1e-12  # the network is in float32
        torch.testing.assert_close(getattr(apart, name), getattr(together, name), atol=error, rtol=error)
    assert calls == sorted(set(calls))
    assert {most for _, most in calls} == {3 * 4}
    assert set(asked) == {preimage.BATCH_MEMORY_SHARE, search.VOTE_MEMORY_SHARE}
    assert sum(set(asked)) < 0.8
