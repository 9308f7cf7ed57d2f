"""From which side an object is seen: the network, its file, its training, and what views of all models say."""

from __future__ import annotations

import gc
import re
import weakref
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from nablahog import HOGSpec, presets
from nablahog.paper.scenes import Scene, SceneSettings, scene
from nablahog.pose import estimate_pose, viewpoint_prior
from nablahog.pose.background import FINE_CELL, pose_spec
from nablahog.pose.best_search import BestSearch
from nablahog.pose.crop import crop_object, typical_camera
from nablahog.pose.model import prepared_model, view_descriptors
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.pose.problem import PoseProblem
from nablahog.pose.similarity import describe
from nablahog.pose.symmetry import compare_sides
from nablahog.pose.viewpoint_prior import (
    ViewpointLearning,
    ViewpointNetwork,
    ViewpointPrior,
    choose_viewpoints,
    default_viewpoints,
    mirror_descriptors,
)
from nablahog.pose.vote import Hypothesis, azimuth_evidence, forget_models, interpolate_evidence, recognizes_models
from nablahog.render import Mesh, render

from ..chairs import chair

SPEC = pose_spec(FINE_CELL)
LEARNING = ViewpointLearning(scenes=64, photographs=1, sha256="", seed=0, epochs=1, losses=(1.0,))


def _noise(count: int, seed: int = 0) -> Tensor:
    return torch.rand(count, 1, 128, 128, generator=torch.Generator().manual_seed(seed))


def _prior(spec: HOGSpec = SPEC, width: int = 2, seed: int = 0) -> ViewpointPrior:
    torch.manual_seed(seed)
    weights = torch.nn.utils.parameters_to_vector(ViewpointNetwork(SPEC.channels, 2).parameters())
    return ViewpointPrior(spec, width, weights.detach().half(), LEARNING)


def test_a_mirrored_image_has_the_mirrored_descriptor() -> None:
    images = torch.rand(2, 1, 64, 64, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(mirror_descriptors(describe(images, SPEC)), describe(images.flip(3), SPEC))


def test_probabilities_add_up_and_are_mirrored_with_the_image() -> None:
    prior, images = _prior(), _noise(5)
    likely = prior.log_probabilities(images)
    torch.testing.assert_close(likely.exp().sum(1), torch.ones(5))
    torch.testing.assert_close(prior.log_probabilities(images.flip(3))[:, [-k % 48 for k in range(48)]], likely)


@given(st.floats(0.01, 100))
def test_contrast_does_not_count(factor: float) -> None:
    network, descriptors = ViewpointNetwork(SPEC.channels, 2).eval(), describe(_noise(2), SPEC)
    torch.testing.assert_close(network(factor * descriptors), network(descriptors))


def test_a_constant_image_has_finite_probabilities() -> None:
    assert _prior().log_probabilities(torch.zeros(1, 1, 128, 128)).isfinite().all()


def test_a_batch_is_its_descriptors_one_by_one() -> None:
    prior, images = _prior(), _noise(4)
    one_by_one = torch.cat([prior.log_probabilities(one[None]) for one in images])
    torch.testing.assert_close(prior.log_probabilities(images), one_by_one)


def test_a_file_holds_the_same_prior(tmp_path: Path) -> None:
    prior = _prior()
    prior.save(tmp_path / "prior.npz")
    again = ViewpointPrior.load(tmp_path / "prior.npz")
    assert again.learning == LEARNING
    assert torch.equal(again.log_probabilities(_noise(2)), prior.log_probabilities(_noise(2)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: _prior(presets.uoctti()), "viewpoint prior"),
        (lambda: _prior(width=0), "the width must be an integer in 1 … 1,024, got 0"),
        (lambda: _prior(width=3), "weights"),
        (lambda: _prior().log_probabilities(torch.zeros(1, 3, 128, 128)), r"got shape \(1, 3, 128, 128\)"),
    ],
)
def test_what_contradicts_itself_is_refused(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]


@given(st.floats(-1000, 1000))
def test_evidence_between_azimuths_is_interpolated_around_the_circle(azimuth: float) -> None:
    evidence = torch.rand(1, 48, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    circle = torch.cat([evidence[0], evidence[0, :1]]).numpy()
    expected = np.interp(azimuth % 360, 7.5 * np.arange(49), circle)
    value = float(interpolate_evidence(evidence, torch.tensor([azimuth], dtype=torch.float64)))
    assert value == pytest.approx(expected, abs=1e-9)


def _turned(mesh: Mesh) -> Mesh:
    x, y, z = mesh.vertices.unbind(1)
    return Mesh(torch.stack([-y, x, z], 1), mesh.faces, mesh.brightness)


def test_the_default_prior_knows_chairs_whose_front_is_where_it_expects_it() -> None:
    prior = default_viewpoints()
    chairs = [chair(seed) for seed in range(3)]
    assert recognizes_models(prior, [prepared_model(mesh) for mesh in chairs])
    assert not recognizes_models(prior, [prepared_model(_turned(mesh)) for mesh in chairs])


def test_models_are_forgotten() -> None:
    """By all caches: a page that gets one after the other keeps none but the last."""
    mesh = chair(5)
    seen = weakref.ref(prepared_model(mesh))
    recognizes_models(default_viewpoints(), [prepared_model(mesh)])
    compare_sides(prepared_model(mesh), 30, 20)
    view_descriptors(prepared_model(mesh), 20)
    forget_models()
    gc.collect()
    assert seen() is None


def _scene(index: int, models: dict[str, Mesh], photographs: list[Tensor]) -> Scene:
    """From all around, at the elevations and sizes that the prior is for."""
    generator = np.random.default_rng(index)
    viewpoint = np.array([[generator.uniform(0, 360), generator.triangular(0, 15, 45), 0.0]])
    settings = SceneSettings(size=160, height=(72.0, 132.0))
    return scene(index, models, viewpoint, photographs, seed=5, settings=settings)


@pytest.mark.slow
def test_the_default_prior_sees_from_which_side_unseen_chairs_are_seen() -> None:
    models = {str(seed): chair(seed) for seed in range(10)}
    photographs = [torch.rand(200, 200, generator=torch.Generator().manual_seed(3))]
    scenes = [_scene(index, models, photographs) for index in range(40)]
    crops = torch.cat([crop_object(one.image, one.box).image for one in scenes])
    azimuths = torch.tensor([float(one.pose[0]) for one in scenes])
    likely = default_viewpoints().log_probabilities(crops).argmax(1)
    apart = ((likely * 7.5 - azimuths + 180) % 360 - 180).abs()
    assert float((apart <= 15).double().mean()) >= 0.6


def test_what_it_has_learned_from_is_said_in_a_line() -> None:
    assert re.fullmatch(r"\d+ scenes, \d+ epochs, last loss \d\.\d{4}", default_viewpoints().summary)


def test_choices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prior = default_viewpoints()
    assert choose_viewpoints(prior) is choose_viewpoints("default") is prior
    assert choose_viewpoints(None) is None
    monkeypatch.setattr(viewpoint_prior, "STORED_VIEWPOINTS", tmp_path / "chairs.npz")
    assert choose_viewpoints("default") is None


def test_another_choice_is_refused() -> None:
    with pytest.raises(ValueError, match="viewpoints must be a ViewpointPrior, 'default' or None, got 3"):
        estimate_pose(torch.rand(1, 64, 64), {"a": chair(1)}, viewpoints=3)  # type: ignore[arg-type]


def test_a_pose_with_a_crop_of_its_own_is_judged_in_the_box_that_was_given() -> None:
    made = _scene(0, {"a": chair(1)}, [torch.rand(200, 200, generator=torch.Generator().manual_seed(3))])
    given, other = (PreparedPhotograph(crop_object(made.image, box)) for box in (made.box, (20, 20, 90, 110)))
    models = {"a": prepared_model(chair(1)), "b": prepared_model(chair(2))}
    problem = PoseProblem(
        made.image, given, made.box, None, models, initial=(0.0, 15.0), viewpoints=default_viewpoints()
    )
    pose = torch.tensor([200.0, 15, 3, 0, 0, 0], dtype=torch.float64)
    own, elsewhere = (Hypothesis(5.0, "a", pose, crop, given) for crop in (given, other))
    evidence = BestSearch(problem).weigh_azimuths([own, elsewhere])
    assert evidence[0] == evidence[1] < 0


def test_views_alone_say_from_which_side_an_object_is_seen() -> None:
    models = [prepared_model(chair(seed)) for seed in range(4)]
    pose = torch.tensor([[140.0, 15, 3, 0, 0, 0]])
    image = render(chair(0), pose, typical_camera())[0]
    photograph = PreparedPhotograph(crop_object(image, (8, 8, 120, 120)))
    evidence = azimuth_evidence(models, [photograph], {15.0: 0.0}, None)
    torch.testing.assert_close(evidence.exp().sum(1), torch.ones(1, dtype=torch.float64))
    assert abs(7.5 * int(evidence[0].argmax()) - 140) <= 15
    steep = azimuth_evidence(models, [photograph], {15.0: 0.0, 60.0: 1000.0}, None)
    torch.testing.assert_close(steep, evidence)
