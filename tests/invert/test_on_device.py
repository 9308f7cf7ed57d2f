"""The search for pre-images as it runs on a device: rounds that wait for nothing, results that are those of a CPU."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.hog import HOGSpec
from nablahog.invert import Search, objective, search, single_scale
from nablahog.invert.flat import FlatRegions
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.priors import Range, RelativeSmoothness
from nablahog.invert.search import PreimageSearch
from nablahog.invert.start import noise
from nablahog.optimize import Minimum, StopReason, running
from nablahog.optimize.lbfgs import LbfgsSearch
from nablahog.runtime import memory

from ..waiting import WithoutWaiting
from .photographs import photograph

SPECS = {"paper": presets.paper(8), "uoctti": presets.uoctti(8)}


def images() -> Tensor:
    flat_in_part = photograph(32, "coins")
    flat_in_part[..., :20] = 0.8
    return torch.cat([photograph(32), flat_in_part, torch.full((1, 1, 32, 32), 0.7)]).double()


@pytest.mark.parametrize("name", SPECS)
def test_pre_images_are_those_of_a_cpu(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = SPECS[name]
    descriptor = hog(images(), spec)
    votes = recover_histograms(descriptor, spec)
    starts = 0.5 + noise(descriptor, 32, 32, 2, seed=0).expand(3, -1, -1, -1, -1)
    calls: list[list[int]] = []

    def run() -> tuple[PreimageSearch, Tensor]:
        calls.append([])
        options, priors = Search(), [RelativeSmoothness(0.02)]
        made = PreimageSearch(
            descriptor, spec, (32, 32), priors, options, 60, lambda done, most: calls[-1].append(done)
        )
        mean = made.match(starts, votes, 18).mean(dim=1)
        return made, made.match(mean.unsqueeze(1), None, made.left(), mean, 1.0)

    on_cpu, its_images = run()
    monkeypatch.setattr(running, "dropped_at_once", lambda like: False)
    on_device, images_there = run()
    assert torch.equal(on_device.evaluations, on_cpu.evaluations)
    assert len(set(on_cpu.evaluations.tolist())) > 1  # the flat image ends, and others go on
    assert on_device.stop_reason == on_cpu.stop_reason
    torch.testing.assert_close(on_device.history(), on_cpu.history(), atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(images_there, its_images, atol=1e-6, rtol=0)
    assert calls[0] == calls[1]


def without_numbers(regions: FlatRegions) -> FlatRegions:
    """On the device where there are none."""
    regions.regions, regions.sizes = regions.regions.to("meta"), regions.sizes.to("meta")
    return regions


@pytest.mark.parametrize("name", SPECS)
@pytest.mark.parametrize("size", [32, 520])
def test_rounds_of_a_search_ask_for_no_number(name: str, size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """HOG itself is taken for what it is on a GPU, kernels that wait for nothing; everything else runs."""
    spec = presets.paper(8) if name == "paper" else presets.uoctti(8)
    image = torch.rand(2, 1, size, size, generator=torch.Generator().manual_seed(0))
    image[:, :, :24] = 0.5
    descriptor = hog(image, spec)
    regions = without_numbers(FlatRegions(descriptor.repeat_interleave(2, 0), spec, size, size))
    assert len(regions.sizes) > 1
    votes = recover_histograms(descriptor, spec)

    def to_cells(images: Tensor, spec: HOGSpec) -> Tensor:
        return images.mean(dim=(2, 3), keepdim=True).expand(len(images), *votes.shape[1:]) + 0.0

    def normalize(cells: Tensor, spec: HOGSpec) -> Tensor:
        return cells[:, :1].expand(-1, descriptor.shape[3], *descriptor.shape[1:3]) + 0.0

    monkeypatch.setattr(search, "FlatRegions", lambda *args: regions)
    monkeypatch.setattr(objective, "steps", lambda device, spec: (to_cells, normalize))
    seen, reports = [], []

    def minimise(name: str, problem: Any, start: Tensor, watch: Any, **options: Any) -> Minimum:
        run = LbfgsSearch(problem, start, 6, 1.0, watch)  # also warms up what is kept on the device
        with WithoutWaiting():
            for _ in range(3):
                run.advance()
                run.end(0.0, 1e-3)
        reason = [StopReason.BUDGET] * len(start)
        return Minimum(run.vectors.x, run.state.values, run.running.evaluations, reason, run.state.values.unsqueeze(0))

    monkeypatch.setattr(search, "minimise", minimise)
    account = PreimageSearch(
        descriptor.to("meta"),
        spec,
        (size, size),
        [RelativeSmoothness(0.02), Range(10.0)],
        Search(),
        100,
        lambda done, most: reports.append(done),
        seen.append,
    )
    start = torch.rand(2, 2, 1, size, size, device="meta")
    found = account.match(start, votes.to("meta"), 25, start.mean(dim=1), 0.3)
    assert found.shape == start.shape
    assert len(seen) == 4
    assert not reports  # the first would be after ten


def test_a_part_takes_a_share_of_the_memory_that_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    cpu, gpu = torch.device("cpu"), torch.device("cuda", 0)
    assert memory.memory_for(cpu, 123, 0.5) == 123
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (600, 10_000))
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda device: 500)
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda device: 100)
    assert memory.memory_for(gpu, 123, 0.5) == 500
    assert memory.memory_for(cpu, 123, 0.5) == 123


def test_batches_are_split_by_that_share(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def memory_for(device: torch.device, on_cpu: int, share: float) -> int:
        asked.append((on_cpu, share))
        return on_cpu // 2**14

    descriptor = hog(images(), SPECS["paper"])
    few = Search(max_evaluations=4, samples=1)
    together = reconstruct(descriptor, SPECS["paper"], search=few)
    monkeypatch.setattr(single_scale, "memory_for", memory_for)
    monkeypatch.setattr(objective, "memory_for", memory_for)
    parts: list[slice] = []
    apart = reconstruct(descriptor, SPECS["paper"], search=few, watch=lambda now: parts.append(now.descriptors))
    assert {(part.start, part.stop) for part in parts} == {(0, 1), (1, 2), (2, 3)}
    torch.testing.assert_close(apart.image, together.image)
    assert (single_scale.MEMORY, single_scale.SHARE) in asked
    assert objective.SHARE in {share for _, share in asked}
    assert objective.SHARE + single_scale.SHARE < 0.8
