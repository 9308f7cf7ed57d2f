"""The confidence of a pose and of its runners-up."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import softmax
from torch import Tensor

from nablahog import Camera, PoseEstimate, estimate_pose, render, sample_chairs
from nablahog.io.images import sample_photograph
from nablahog.metrics import rotation_error
from nablahog.pose.confidence import Evidence, probabilities
from nablahog.pose.crop import crop_object
from nablahog.pose.evidence import compare_turned, probability_in_range
from nablahog.pose.model import azimuth_distance, prepared_model
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.pose.result import OPPOSITE, SECOND_CONFIDENCE, see_opposite_sides

from .common import SWIVEL, model, photographed

ALONE = Evidence(True, 8.0, 0.1, 0.3, 1.0, (0.9, 0.6))
AMONG = Evidence(False, 6.0, 0.1, 0.3, 0.6, (0.5, 0.1))


@pytest.mark.parametrize("evidence", [ALONE, AMONG])
def test_the_rest_to_one_is_that_no_pose_is_right(evidence: Evidence) -> None:
    for shares in ((), (1.0,), (1.0, 1.0, 1.0), (0.0,)):
        for similarity in (-5.0, 0.0, 5.0, 1e6):
            sure = probabilities(replace(evidence, shares=shares, similarity=similarity))
            assert all(0 <= p <= 1 for p in sure)
            assert sum(sure) <= 1 + 1e-9
            assert len(sure) == 1 + len(shares)


def test_a_side_that_fits_as_well_is_as_likely() -> None:
    sure = probabilities(replace(ALONE, similarity=30.0, shares=(1.0,)))
    assert sure == pytest.approx((0.5, 0.5), abs=1e-3)


def test_the_fitted_weights() -> None:
    """Odds by SciPy's softmax, of the weights that benchmarks/confidence.py has printed."""
    alone = -5.48 + 5.73 * math.log(9) - 3.88 * 0.1 - 11.44 * 0.3
    logits = [0, alone, alone + 25.98 * math.log(0.9), alone + 25.98 * math.log(0.6)]
    assert probabilities(ALONE) == pytest.approx(softmax(logits)[1:])
    among = -0.01 - 2.84 * 0.1 - 6.09 * 0.3 + 5.57 * 0.6
    logits = [0, among, among + 1.05 * math.log(0.5), among + 1.05 * math.log(0.1)]
    assert probabilities(AMONG) == pytest.approx(softmax(logits)[1:])
    upright = probabilities(replace(AMONG, upright=2.0, shares=()))[0]
    assert math.log(upright / (1 - upright)) == pytest.approx(among + 2 * 0.72)
    assert probabilities(replace(AMONG, in_range=0.5))[0] < probabilities(AMONG)[0] / 2


def crate() -> Tensor:
    """A regular pattern, (1, 180, 180)."""
    y, x = torch.meshgrid(torch.arange(180), torch.arange(180), indexing="ij")
    return 0.2 + 0.6 * ((x // 24 + y // 24) % 2).float()[None]


def test_a_regular_pattern_has_a_sidelobe_and_an_object_has_none() -> None:
    template = PreparedPhotograph(crop_object(crate(), (30, 30, 142, 142))).calibrated
    pattern = crop_object(crate(), (30, 30, 142, 142)).downsample(template.shrink).image
    assert template.sidelobe(pattern) > 0.6
    square = torch.full((1, 180, 180), 0.5)
    square[:, 60:120, 60:120] = 1
    crop = crop_object(square, (30, 30, 142, 142))
    template = PreparedPhotograph(crop).calibrated
    assert template.sidelobe(crop.downsample(template.shrink).image) < 0.5
    assert template.sidelobe(torch.zeros(1, 1, 64, 64)) == 1.0  # nothing is rendered


def test_an_object_is_like_the_models_only_upright() -> None:
    meshes = list(sample_chairs().values())[:3]
    camera, penalties = Camera.from_field_of_view(30, 128, 128), {0.0: 0.0, 15.0: 0.0, 30.0: 1.0}
    (image,) = render(meshes[0], torch.tensor([[30.0, 15, 2, 0, 0, 0]]), camera)
    models = [prepared_model(mesh) for mesh in meshes]

    def compare(photograph: Tensor) -> float:
        crop = crop_object(photograph, (8, 8, 120, 120))
        return compare_turned(models, PreparedPhotograph(crop), penalties)

    upright = compare(image)
    assert upright > 1
    for quarters in (1, 2, 3):  # as unlike, but for what rounding does
        assert compare(image.rot90(quarters, (1, 2))) < -upright + 0.1
    same_all_around = image + image.rot90(1, (1, 2)) + image.rot90(2, (1, 2)) + image.rot90(3, (1, 2))
    assert compare(same_all_around / 4) == pytest.approx(0, abs=0.05)


def test_a_turned_crop_is_valid_where_the_photograph_is() -> None:
    photograph = torch.rand(1, 100, 100, generator=torch.Generator().manual_seed(0))
    cut = crop_object(photograph, (60, 70, 130, 110))
    for quarters in (1, 2, 3):
        turned = cut.turn_quarters(quarters)
        whole = crop_object(photograph.rot90(quarters, (1, 2)), turn_box((60, 70, 130, 110), quarters))
        assert torch.equal(turned.image, cut.image.rot90(quarters, (2, 3)))
        assert tuple(turned.valid) == pytest.approx(tuple(whole.valid))


def turn_box(box: tuple[float, float, float, float], quarters: int) -> tuple[float, ...]:
    """The box in a photograph of 100x100 pixels that is turned counter-clockwise."""
    corners = np.array(box).reshape(2, 2) - 50
    for _ in range(quarters):
        corners = corners @ [[0, -1], [1, 0]]
    return *corners.min(axis=0) + 50, *corners.max(axis=0) + 50


@pytest.mark.slow
@pytest.mark.parametrize("name", ["brick", "coins"])
def test_a_model_that_is_not_there_has_a_low_confidence(name: str) -> None:
    estimate = estimate_pose(sample_photograph(name), sample_chairs()["wooden-0"])
    assert estimate.confidence is not None
    assert estimate.confidence < 0.3


@pytest.fixture(scope="module")
def estimate() -> PoseEstimate:
    """Of a chair that is not there, and has runners-up."""
    return estimate_pose(sample_photograph("coffee"), sample_chairs()["wooden-0"], box=(100, 50, 400, 350))


def test_the_half_turn_is_weighed_even_if_no_search_has_come_to_it(estimate: PoseEstimate) -> None:
    own, *views = [(each.azimuth, each.elevation, each.theta) for each in (estimate, *estimate.runners_up)]
    confidences = [rival.confidence for rival in estimate.runners_up]
    expected = sum(sure or 0 for view, sure in zip(views, confidences, strict=True) if see_opposite_sides(own, view))
    assert estimate.half_turn == pytest.approx(expected)
    assert estimate.evidence is not None
    assert estimate.evidence.shares == tuple(rival.share for rival in estimate.runners_up)
    assert [estimate.confidence, *confidences] == pytest.approx([*probabilities(estimate.evidence)])
    image, around = photographed(model(SWIVEL), 40, 18)
    clear = estimate_pose(image, model(SWIVEL), box=around)
    assert max(azimuth_distance(clear.azimuth, rival.azimuth) for rival in clear.runners_up) > 179
    assert clear.half_turn


def test_opposite_sides_are_a_half_turn_around_the_object_apart() -> None:
    assert see_opposite_sides((300, 20, 3), (119, 25, 0))
    assert see_opposite_sides((300, 0, 0), (120 + OPPOSITE - 0.1, 0, 0))
    assert not see_opposite_sides((300, 0, 0), (120 + OPPOSITE + 0.1, 0, 0))
    assert not see_opposite_sides((300, 20, 3), (300, 20, 3))
    assert not see_opposite_sides((309, 3, 2), (135, 90, 45))  # from above


def test_the_second_answer_is_the_likeliest_runner_up_above_a_limit(estimate: PoseEstimate) -> None:
    first, *_ = estimate.runners_up
    few, more, most = (replace(first, confidence=SECOND_CONFIDENCE + off) for off in (0, 0.01, 0.05))
    assert replace(estimate, runners_up=(few, more, most)).second is most
    assert replace(estimate, runners_up=(few,)).second is None
    unsure = replace(estimate, confidence=None, runners_up=(replace(first, confidence=None),))
    assert (unsure.second, unsure.half_turn) == (None, None)
    assert first.half_turn is None
    opposite = replace(
        first, azimuth=estimate.azimuth + 180, elevation=estimate.elevation, theta=estimate.theta - OPPOSITE / 2
    )
    rivals = tuple(replace(opposite, confidence=confidence) for confidence in (0.0, 0.25, 0.125))
    assert replace(estimate, runners_up=rivals).half_turn == 0.375


def test_the_probability_of_a_range_follows_bayes() -> None:
    near = torch.zeros(48, dtype=torch.bool)
    near[[47, 0, 1, 2]] = True
    likely = torch.rand(48, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    for shift in (0.0, -70.0):
        odds = 4 * float(likely[near].mean() / likely[~near].mean())  # 4 to 1 without evidence
        assert probability_in_range(likely.log() + shift, near) == pytest.approx(odds / (1 + odds))
    assert probability_in_range(torch.zeros(48, dtype=torch.float64), near) == pytest.approx(0.8)
    assert probability_in_range(likely.log(), ~torch.zeros_like(near)) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("models", [1, 4])
def test_a_range_without_the_object_has_a_low_confidence(models: int) -> None:
    meshes = dict(list(sample_chairs().items())[:models])
    camera, box = Camera.from_field_of_view(30, 128, 128), (28, 12, 95, 125)
    (image,) = render(next(iter(meshes.values())), torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)
    near, wrong = (estimate_pose(image, meshes, box=box, initial=(first, 20), within=10) for first in (35, 200))
    assert near.confidence is not None
    assert near.confidence > 0.9
    assert wrong.confidence is not None
    assert wrong.confidence < 0.01
    # the other side is no answer where it is not allowed
    assert all(azimuth_distance(pose.azimuth, 200) <= 10 for pose in (wrong, *wrong.runners_up))
    if models > 1:
        flat = estimate_pose(torch.full_like(image, 0.5), meshes, box=box, initial=(200, 20), within=10)
        assert flat.confidence is not None
        assert flat.confidence < 0.3


@pytest.mark.slow
def test_a_uniform_photograph_without_a_box_has_a_pose_that_is_not_trusted() -> None:
    flat = estimate_pose(torch.full((1, 128, 128), 0.5), model())
    assert flat.confidence is not None
    assert flat.confidence < 0.1


def test_a_pose_from_straight_above_is_trusted_however_its_rotation_is_written() -> None:
    camera = Camera.from_field_of_view(30, height=128, width=128)
    for azimuth in (30.0, 100.0):
        view = torch.tensor([[azimuth, 90, 2, 0, 0, 0]])
        estimate = estimate_pose(render(model(), view, camera)[0], model(), box=(20, 20, 108, 108))
        angles = torch.tensor([[estimate.azimuth, estimate.elevation, estimate.theta]])
        assert float(rotation_error(angles.numpy(), view[:, [0, 1, 3]].numpy())[0]) < 5
        assert estimate.confidence is not None
        assert estimate.confidence > 0.8
        assert estimate.half_turn is not None
        assert estimate.half_turn < 0.1
