"""Scenes: the truth they state, repeatability, and what composing does to an image."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from nablahog.hog.gradient import gray
from nablahog.inputs.boxes import Box
from nablahog.paper.scenes import Scene, SceneSettings, compose, scene
from nablahog.render import silhouette

from ..render.shapes import box

RAMP = np.linspace(0, 1, 90 * 120).reshape(90, 120)
NOISE = np.random.default_rng(0).random((3, 150, 100))
VIEWS = np.array([[30.0, 20, 0], [200, 10, -8], [300, 40, 5]])
ONES = dict.fromkeys(("albedo", "ambient", "gamma", "exposure"), (1, 1))
NOTHING = {**dict.fromkeys(("contrast", "blur", "noise"), (0, 0)), "tint": 0, "occlusion": 0, "box_jitter": 0}
CLEAN = SceneSettings(size=96, height=(50, 60), **ONES, **NOTHING)  # type: ignore[arg-type]
SIZES = {"cube": (1, 1, 1), "slab": (3, 1, 0.4), "tower": (1, 1, 3)}
MODELS = {name: box(size, 0.6).normalized() for name, size in SIZES.items()}


def _scene(index: int, settings: SceneSettings, seed: int = 0) -> Scene:
    return scene(index, MODELS, VIEWS, [RAMP, NOISE], seed=seed, settings=settings)


@pytest.mark.slow
def test_truth_is_where_the_object_is_seen() -> None:
    seen = set()
    for index in range(12):
        made = _scene(index, CLEAN)
        coverage = silhouette(MODELS[made.model], made.pose[None], made.camera)[0, 0]
        image = gray(made.image[None])[0, 0]
        outside = image[coverage == 0]
        assert float(outside.max() - outside.min()) < 1e-5
        behind = float(outside.mean())
        torch.testing.assert_close(image, 0.6 * coverage + behind * (1 - coverage), atol=2e-3, rtol=0)
        rows, columns = torch.nonzero(coverage, as_tuple=True)
        tight = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        np.testing.assert_allclose(made.box, tight, atol=1.5)
        seen.add(made.model)
    assert seen == set(MODELS)


def test_poses_come_from_the_viewpoints() -> None:
    for index in range(12):
        made = _scene(index, CLEAN)
        azimuth, elevation, distance, theta = made.pose[:4].tolist()
        assert [azimuth, elevation, theta] in VIEWS.tolist()
        assert 2.5 <= distance <= 4
        assert abs(float(made.initial[1]) - elevation) <= 5
        assert made.initial[2:].tolist() == [3.25, 0, 0, 0]


def test_initial_elevations_and_boxes_stay_in_their_ranges() -> None:
    steep, rough = np.array([[30.0, 89.9, 0], [200, -89.9, 0]]), replace(CLEAN, box_jitter=1)
    made = [scene(index, MODELS, steep, [RAMP], settings=rough) for index in range(12)]
    assert {float(each.initial[1]) for each in made if abs(each.initial[1]) >= 90} == {90, -90}
    assert all(0 <= side <= 96 for each in made for side in each.box)


@pytest.mark.slow
def test_box_errors_have_the_given_size() -> None:
    settings = replace(CLEAN, size=256, box_jitter=0.02)
    errors = []
    for index in range(60):
        made, exact = (_scene(index, replace(settings, box_jitter=jitter)).box for jitter in (0.02, 0))
        x0, y0, x1, y1 = exact
        errors.append((np.array(made) - exact) / (x1 - x0, y1 - y0, x1 - x0, y1 - y0))
    assert np.std(errors) == pytest.approx(0.02, rel=0.2)
    assert abs(np.mean(errors)) < 0.004


# composing needs no renderer

EMPTY = np.zeros((3, 80, 80))
FULL = np.ones((80, 80))
WHOLE = Box(0.0, 0.0, 80.0, 80.0)


def _composed(
    picture: np.ndarray, coverage: np.ndarray, photo: np.ndarray, seed: int = 0, **changes: Any
) -> np.ndarray:
    settings = replace(CLEAN, contrast=(1, 1), **changes)
    return compose(picture, coverage, WHOLE, [photo], settings, np.random.default_rng(seed))


def test_clutter_only_where_the_object_is_not() -> None:
    coverage = np.zeros((80, 80))
    coverage[20:60, 30:50] = 1
    coverage[60:70, 30:50] = 0.5
    image = _composed(EMPTY + 0.5 * coverage, coverage, np.ones((1, 90, 90)))
    np.testing.assert_allclose(image[:, 20:60, 30:50], 0.5)
    np.testing.assert_allclose(image[:, 60:70, 30:50], 0.75)
    np.testing.assert_allclose(image[:, :, :30], 1)


def test_clutter_is_part_of_the_photograph() -> None:
    ramp = np.linspace(0.2, 0.6, 200)[None, None].repeat(200, axis=1)
    for seed in range(5):
        image = _composed(EMPTY, 0 * FULL, ramp, seed, zoom=(0.5, 2))
        rows = np.diff(image[0], axis=1)
        assert (rows > 0).all() or (rows < 0).all()  # perhaps mirrored, never torn
        assert 0.2 - 1e-6 <= image.min() < image.max() <= 0.6 + 1e-6
        np.testing.assert_allclose(image, image[:1, :1].repeat(3, 0).repeat(80, 1), atol=1e-9)


def test_colours_of_photographs_and_tints() -> None:
    photo = np.array([0.2, 0.4, 0.8])[:, None, None] * np.ones((1, 50, 60))
    image = _composed(EMPTY, 0 * FULL, photo, tint=0.5)
    np.testing.assert_allclose(image[:, 0, 0], [0.2, 0.4, 0.8])
    tinted = _composed(EMPTY, 0 * FULL, np.full((1, 50, 60), 0.5), tint=0.4)
    assert np.ptp(tinted[:, 0, 0]) > 0.01
    assert float(gray(torch.from_numpy(tinted)[None])[0, 0, 0, 0]) == pytest.approx(0.5)


def test_occluder_covers_what_it_should() -> None:
    shares, shapes = [], set()
    for seed in range(40):
        image = _composed(EMPTY, FULL, np.ones((1, 90, 90)), seed, occlusion=1, occluded=(0.1, 0.2))
        shares.append(image[0].mean())
        shapes.add((bool(image[0].any(0).all()), bool(image[0].any(1).all())))
    assert min(shares) > 0.08
    assert max(shares) < 0.22
    assert shapes == {(True, False), (False, True), (False, False)}  # lying bars, upright bars, patches


def test_nothing_is_brighter_than_white_before_it_is_exposed() -> None:
    image = _composed(EMPTY + 1.5, FULL, np.ones((1, 90, 90)), exposure=(0.5, 0.5))
    np.testing.assert_allclose(image, 0.5)


def test_sensor_noise() -> None:
    image = _composed(EMPTY + 0.5, FULL, np.ones((1, 90, 90)), noise=(0.03, 0.03))
    assert image.std() == pytest.approx(0.03, rel=0.05)
    np.testing.assert_allclose(image[0], image[1])


def test_blur_exposure_and_gamma() -> None:
    edge = EMPTY.copy()
    edge[:, :, 40:] = 1
    blurred = _composed(edge, FULL, np.ones((1, 90, 90)), blur=(2, 2))
    assert np.diff(blurred[0, 40]).max() == pytest.approx(1 / np.sqrt(2 * np.pi * 4), rel=0.05)
    image = _composed(EMPTY + 0.25, FULL, np.ones((1, 90, 90)), gamma=(0.5, 0.5), exposure=(1.2, 1.2))
    np.testing.assert_allclose(image, 0.6)


def test_settings_are_checked() -> None:
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"height": (140, 100)}, "height must be .* a range from low to high"),
        *(({name: 1.5}, "occlusion, .* must lie in 0…1") for name in ("occlusion", "tint", "shadow", "gloss")),
        *(({name: (0.5, 1.5)}, "occlusion, .* must lie in 0…1") for name in ("ambient", "occluded")),
        ({"distance": (1, 2)}, "distance must be above 1"),
        ({"size": 100}, "height between 1 and size - 12"),
        ({"height": (0.5, 100)}, "height between 1 and size - 12"),
        *(({name: (0, 1)}, "gamma must be above 0") for name in ("occluded", "zoom", "gamma")),
        ({"jpeg": (1, 95.5)}, "jpeg must be .* or lie in 1…95"),
        ({"jpeg": (0, 50)}, "jpeg must be .* or lie in 1…95"),
        ({"jpeg": (0.5, 95)}, "jpeg must be .* or lie in 1…95"),
    ]
    for changes, message in wrong:
        with pytest.raises(ValueError, match=message):
            SceneSettings(**changes)
    SceneSettings(jpeg=(1, 95), occlusion=1, tint=1, shadow=1, gloss=1, ambient=(0, 1), occluded=(0.1, 1))
    SceneSettings(size=112, height=(1, 100))


def test_viewpoints_and_photographs_are_checked() -> None:
    wrong: list[tuple[np.ndarray, list[np.ndarray], str]] = [
        (VIEWS, [], "expected models and photographs, got 3 and 0"),
        (VIEWS[0], [RAMP], r"expected viewpoints of shape \(N, 3\), .* got \(3,\)"),
        (VIEWS[:, :2], [RAMP], r"expected viewpoints of shape \(N, 3\), .* got \(3, 2\)"),
        (VIEWS[:0], [RAMP], r"expected viewpoints of shape \(N, 3\), .* got \(0, 3\)"),
        (VIEWS, [NOISE[None]], r"expected a photograph of shape .* got \(1, 3, 150, 100\)"),
        (VIEWS, [RAMP[0]], r"expected a photograph of shape .* got \(120,\)"),
        (VIEWS, [NOISE[:2]], r"expected a photograph of shape .* got \(2, 150, 100\)"),
        (VIEWS, [NOISE[:, :0]], r"expected a photograph of shape .* got \(3, 0, 100\)"),
        (VIEWS, [RAMP * np.nan], "photograph in 0…1"),
    ]
    for viewpoints, photographs, message in wrong:
        with pytest.raises(ValueError, match=message):
            scene(0, MODELS, viewpoints, photographs, settings=CLEAN)
