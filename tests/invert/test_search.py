"""One reconstruction's minimisations and its account."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets
from nablahog.invert import Search
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.priors import RelativeSmoothness
from nablahog.invert.search import PreimageSearch
from nablahog.invert.start import noise
from nablahog.optimize import Minimiser

from .photographs import photograph

SPEC = presets.paper(8)
IMAGES = torch.cat([photograph(32), photograph(32, "coins"), torch.full((1, 1, 32, 32), 0.7)]).double()
DESCRIPTORS = hog(IMAGES, SPEC)
VOTES = recover_histograms(DESCRIPTORS, SPEC)


def search(
    descriptors: Tensor = DESCRIPTORS,
    budget: int = 100,
    minimiser: Minimiser = "lbfgs",
    progress: Callable[[int, int], None] | None = None,
) -> PreimageSearch:
    return PreimageSearch(
        descriptors, SPEC, (32, 32), [RelativeSmoothness(0.02)], Search(minimiser=minimiser), budget, progress
    )


def starts(count: int) -> Tensor:
    return 0.5 + noise(DESCRIPTORS, 32, 32, count, seed=0).expand(3, -1, -1, -1, -1)


def relative(images: Tensor) -> Tensor:
    """Distances (B, K) of images (B, K, 1, H, W)."""
    own = hog(images.flatten(0, 1), SPEC).view(*images.shape[:2], *DESCRIPTORS.shape[1:])
    return (own - DESCRIPTORS.unsqueeze(1)).flatten(2).norm(dim=2) / DESCRIPTORS.flatten(1).norm(dim=1).unsqueeze(1)


def test_evaluations_of_all_images_of_a_descriptor_add_up() -> None:
    account = search()
    assert account.left() == 100
    result = account.match(starts(3), VOTES, 12)
    assert result.shape == (3, 3, 1, 32, 32)
    # the flat image's start is flat already: one evaluation shows it, another that nothing moves
    textured, flat = account.evaluations[:2].tolist(), int(account.evaluations[2])
    assert textured == [36, 36]
    assert flat in (3, 6)
    assert account.left() == 64
    assert account.history().shape == (36, 3)
    account.match(result.mean(dim=1, keepdim=True), None, account.left())
    assert account.evaluations[:2].tolist() == [100, 100]
    assert account.evaluations[2] < 10
    assert account.history().shape == (100, 3)
    assert account.left() == 1  # never nothing, as a minimiser cannot spend nothing
    assert len(account.stop_reason) == 3


@pytest.mark.parametrize("minimiser", ["lbfgs", "dogleg"])
def test_the_account_of_any_minimiser(minimiser: Minimiser) -> None:
    calls: list[tuple[int, int]] = []
    account = search(budget=60, minimiser=minimiser, progress=lambda *call: calls.append(call))
    result = account.match(starts(2), VOTES, 20)
    assert (account.evaluations <= 40).all()
    assert (account.evaluations[:2] > 20).all()
    account.match(result[:, :1], None, account.left(), IMAGES, 0.1)
    assert (account.evaluations <= 60).all()
    history = account.history()
    assert history.shape == (int(account.evaluations.max()), 3)
    assert torch.isfinite(history).all()
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert done[-1] <= int(account.evaluations.max())
    assert {call[1] for call in calls} == {60}


def test_history_begins_with_the_starts_distance_and_counts_one_image_after_the_other() -> None:
    account = search()
    begin = starts(2)
    first = relative(begin)
    account.match(begin, VOTES, 5)
    history = account.history()
    torch.testing.assert_close(history[0, :2], first[:2, 0])  # a flat descriptor makes its start flat
    alone = search()
    alone.match(begin[:, :1], VOTES, 5)
    other = search()
    other.match(begin[:, 1:], VOTES, 5)
    torch.testing.assert_close(alone.history()[-1, :2], relative(last(begin[:, :1]))[:2, 0])
    assert len(history) == 10
    # what was seen after the first image's first evaluation and the last of the second
    torch.testing.assert_close(history[-1, :2], other.history()[-1, :2])


def last(begin: Tensor) -> Tensor:
    """Where five evaluations of L-BFGS look last."""
    seen: list[Tensor] = []
    account = search()
    image = account.unknowns.image

    def watched(unknowns: Tensor) -> Tensor:
        seen.append(image(unknowns).detach())
        return image(unknowns)

    account.unknowns.image = watched  # type: ignore[method-assign]
    account.match(begin, VOTES, 5)
    evaluated = [x for x in seen if len(x) == 2]  # without the flat one, which has ended; the last is the answer
    return torch.cat([evaluated[-1].unsqueeze(1), begin[2:]])


@pytest.mark.parametrize("on_votes", [True, False])
@pytest.mark.parametrize("minimiser", ["lbfgs", "dogleg"])
def test_images_of_a_descriptor_do_not_influence_each_other(on_votes: bool, minimiser: Minimiser) -> None:
    begin = starts(3)
    votes = VOTES if on_votes else None
    given: dict[str, Any] = {"expected": IMAGES.flip(0), "closeness": 0.1}
    together = search(minimiser=minimiser)
    result = together.match(begin, votes, 12, **given)
    spent = torch.zeros(3, dtype=torch.long)
    for k in range(3):
        one = search(minimiser=minimiser)
        torch.testing.assert_close(one.match(begin[:, k : k + 1], votes, 12, **given)[:, 0], result[:, k])
        spent += one.evaluations
    assert torch.equal(spent, together.evaluations)


def test_descriptors_do_not_influence_each_other() -> None:
    begin = starts(2)
    together = search()
    result = together.match(begin, VOTES, 12)
    history = together.history()
    for i in range(3):
        one = search(DESCRIPTORS[i : i + 1])
        torch.testing.assert_close(one.match(begin[i : i + 1], VOTES[i : i + 1], 12)[0], result[i])
        assert one.evaluations[0] == together.evaluations[i]
        own = one.history()[:, 0]
        torch.testing.assert_close(history[: len(own), i], own)
        assert (history[len(own) :, i] == own[-1]).all()


def test_what_is_found_is_closer_than_the_start_and_not_far_from_what_is_expected() -> None:
    begin = starts(1)
    free = search().match(begin, None, 30)
    assert (relative(free)[:2] < 0.5 * relative(begin)[:2]).all()
    kept = search().match(begin, None, 30, IMAGES[[1, 0, 2]], 10.0)

    def away(images: Tensor) -> Tensor:
        difference = images[:2, 0] - IMAGES[[1, 0]]
        return (difference - difference.mean(dim=(2, 3), keepdim=True)).flatten(1).norm(dim=1)

    assert (away(kept) < 0.3 * away(free)).all()
    assert (relative(kept)[:2] > relative(free)[:2]).all()
