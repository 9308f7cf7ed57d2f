"""How many votes hang on a rule, in images made for it."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from nablahog.dialects.describer import Describer
from nablahog.dialects.ties import Ties, ties
from nablahog.hog import HOGSpec

from .common import CAT, SPECS


def _ties(image: Tensor, spec: HOGSpec) -> Ties:
    return ties(Describer(image), spec)


def _steps(axis: int, height: int = 32, width: int = 40) -> Tensor:
    """Rising along one axis: all gradients point along it."""
    along = torch.arange(height)[:, None] if axis == 0 else torch.arange(width)
    return (3 * along).expand(height, width).to(torch.uint8)


def test_gradients_straight_down_are_between_bins_that_begin_at_0() -> None:
    down, across = _steps(0)[None], _steps(1)[None]
    for name in ("vlfeat", "dpm", "dlib", "seeing3d"):
        assert _ties(down, SPECS[name]).between_bins == 1
        assert _ties(across, SPECS[name]).between_bins == 0
    assert _ties(down, SPECS["skimage"]).between_bins == 0
    assert _ties(across, SPECS["skimage"]).between_bins == 1
    assert _ties(down, SPECS["maskfeat"]).between_bins == 1  # whose angles begin there
    assert _ties(across, SPECS["maskfeat"]).between_bins == 0


def test_half_of_the_gradients() -> None:
    """A quarter of the image rises to the right as well; where both meet, a column sees half a step of that."""
    image = _steps(0, 34, 42).long()
    image[:, 22:] += 2 * torch.arange(20)
    result = _ties(image.to(torch.uint8)[None], SPECS["vlfeat"])
    assert result.gradients == 32 * 40
    assert result.between_bins == 21 / 40  # columns 1 … 21 of 1 … 40; column 22 sees 2 to its right


def test_linear_votes_need_no_rule() -> None:
    for name in ("paper", "uoctti", "aubry", "opencv"):
        assert _ties(CAT, SPECS[name]).between_bins is None
        assert _ties(CAT, SPECS[name]).directions == ()


def test_directions_of_ties() -> None:
    assert _ties(CAT, SPECS["vlfeat"]).directions == (90, 270)
    assert _ties(CAT, SPECS["seeing3d"]).directions == (90,)
    assert _ties(CAT, SPECS["skimage"]).directions == (0,)
    assert _ties(CAT, SPECS["maskfeat"]).directions == (90,)
    eight = replace(SPECS["skimage"], bins=8)
    assert _ties(CAT, eight).directions == (0, 45, 90, 135)


def test_no_other_direction_is_met_by_bytes() -> None:
    """What lies between bins in a photograph is vertical: 10°, 30° and 50° have no tangent of small integers."""
    plane = CAT[:1].double()
    gx, gy = plane[0, 1:-1, 2:] - plane[0, 1:-1, :-2], plane[0, 2:, 1:-1] - plane[0, :-2, 1:-1]
    voting = (gx != 0) | (gy != 0)
    result = _ties(CAT[:1], SPECS["vlfeat"])
    assert result.gradients == voting.sum()
    assert result.between_bins == pytest.approx(float((voting & (gx == 0)).sum() / voting.sum()))
    assert result.between_bins > 0.01


def test_colours_tie_where_two_differ_in_direction_alone() -> None:
    down, across, nothing = _steps(0, 40), _steps(1, 40), torch.zeros(40, 40, dtype=torch.uint8)
    for image, share in [
        ((down, across, nothing), 1.0),
        ((nothing, across, down), 1.0),
        ((down, down, nothing), 0.0),  # the same vote, whichever counts
        ((down, across // 3, nothing), 0.0),
        ((down, across // 3, across // 3 * 2), 0.0),  # only the largest matter
    ]:
        assert _ties(torch.stack(image), SPECS["vlfeat"]).between_colours == share


def test_opposite_gradients_are_the_same_without_sign() -> None:
    down = _steps(0, 40)
    image = torch.stack([down, down.flip(0), down])
    assert _ties(image, SPECS["vlfeat"]).between_colours == 1
    assert _ties(image, SPECS["seeing3d"]).between_colours == 0


def test_where_no_channel_is_chosen_none_ties() -> None:
    assert _ties(CAT, SPECS["skimage"]).between_colours is None
    assert _ties(CAT, SPECS["maskfeat"]).between_colours is None
    assert _ties(CAT[:1], SPECS["vlfeat"]).between_colours is None
    assert _ties(CAT, SPECS["maskfeat"]).gradients > _ties(CAT, SPECS["skimage"]).gradients


def test_value_range_makes_no_tie() -> None:
    dpm = SPECS["dpm"]
    assert _ties(CAT, replace(dpm, value_range=1.0)) == _ties(CAT, dpm)


def test_a_flat_image_has_none() -> None:
    flat = torch.full((3, 32, 32), 7, dtype=torch.uint8)
    assert _ties(flat, SPECS["vlfeat"]) == Ties(0, 0.0, 0.0, (90.0, 270.0))
