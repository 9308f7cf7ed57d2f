"""Exemplars: what is kept of the renderings of a model, and that it is learned only once."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import conv2d
from torch.testing import assert_close

from nablahog.hog import hog
from nablahog.io.images import sample_photograph
from nablahog.paper.baselines import exemplar_views as learning
from nablahog.paper.baselines.exemplar_views import (
    EXEMPLAR_SPEC,
    ExemplarLibrary,
    ExemplarViews,
    ViewSampling,
    calibration,
    learn_views,
    pyramid,
)
from nablahog.pose.background import default_background
from nablahog.pose.photograph import EMPTY
from nablahog.pose.whitening import Background
from nablahog.render import Camera, Mesh, Renderer

from ...chairs import chair
from ...io import tiny_models
from ...io.archives import check_refused

FEW = ViewSampling(azimuths=(0, 75), elevations=(20,))


@pytest.fixture(scope="module")
def background() -> Background:
    return default_background(EXEMPLAR_SPEC)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return chair(1)


@pytest.fixture(scope="module")
def views(mesh: Mesh, background: Background) -> ExemplarViews:
    return learn_views(mesh, background, FEW)


def test_viewpoints_of_the_released_code() -> None:
    assert ViewSampling().azimuths[:4] == (0, 11, 23, 34)
    assert ViewSampling().azimuths[-1] == 348
    assert len(ViewSampling().azimuths) == 31
    poses = ViewSampling().poses()
    assert poses.shape == (62, 6)
    assert len(poses.unique(dim=0)) == 62
    assert (poses[:, 2] == 2).all()
    assert poses[:, 1].unique().tolist() == [20, 30]
    assert pytest.approx(290.55, abs=0.01) == learning.FOCAL  # 300 pixels at 54.611°


def test_what_they_are_is_said_in_a_line(views: ExemplarViews) -> None:
    assert repr(views) == f"<ExemplarViews: 2 views, {len(views.scale)} elements>"


@pytest.mark.slow
def test_elements_are_patches_of_renderings(mesh: Mesh, views: ExemplarViews, background: Background) -> None:
    camera = Camera(learning.FOCAL, learning.RENDERING_SIDE, learning.RENDERING_SIDE)
    images = Renderer(mesh, camera, light=learning.LIGHT, supersampling=2)(FEW.poses())[:, 0]
    assert views.viewpoints.tolist() == [[0, 20], [75, 20]]
    assert 8 <= len(views.scale) <= 20
    for view, image in enumerate(images):
        levels = pyramid(image, (10, 10))
        assert len(levels) > 6
        for e in range(*views.first[view : view + 2].tolist()):
            row, col = views.positions[e].tolist()
            patch = levels[views.level[e]][None, row : row + 10, col : col + 10]
            weights = background.whiten(patch)[0] * (patch[0].sum(-1, keepdim=True) > EMPTY)
            assert_close(views.weights[e], weights, rtol=1e-4, atol=1e-4)
            assert background.discriminability(patch) > 2 * background.discriminability(torch.zeros_like(patch))
        dark = (image < 0.95).nonzero()
        assert_close(views.boxes[view, [1, 0]], dark.amin(0).float(), rtol=0, atol=1)
        assert_close(views.boxes[view, [3, 2]], dark.amax(0).float() + 1, rtol=0, atol=1)
    scale, offset = calibration(views.weights, background)
    assert_close((views.scale, views.offset), (scale, offset))


def test_elements_of_a_view_are_apart_and_on_the_object(views: ExemplarViews) -> None:
    pixels = learning.CELL_SIDE * 2 ** (views.level / learning.OCTAVE_LEVELS)
    low = views.positions * pixels[:, None]
    high = (views.positions + 10) * pixels[:, None]
    for view in range(2):
        of_view = range(*views.first[view : view + 2].tolist())
        box = views.boxes[view]
        for a, b in itertools.combinations(of_view, 2):
            shared = (torch.minimum(high[a], high[b]) - torch.maximum(low[a], low[b])).clamp(min=0).prod()
            around = (torch.maximum(high[a], high[b]) - torch.minimum(low[a], low[b])).prod()
            assert shared <= 0.2501 * around
        for a in of_view:
            middle = (low[a] + high[a]) / 2
            assert (middle.flip(0) >= box[:2]).all()
            assert (middle.flip(0) <= box[2:]).all()
    assert len(views.level.unique()) > 1


def test_levels_of_a_pyramid() -> None:
    image = torch.rand(100, 200)
    shapes = [tuple(level.shape) for level in pyramid(image, (5, 5))]
    assert shapes[:4] == [(20, 40, 9), (16, 32, 9), (13, 25, 9), (10, 20, 9)]
    assert shapes[-1][0] == 5
    assert pyramid(image[:20], (5, 5)) == []


def test_other_backgrounds_are_refused(mesh: Mesh, background: Background) -> None:
    other = dataclasses.replace(background, spec=dataclasses.replace(EXEMPLAR_SPEC, cell_size=(8, 8)))
    with pytest.raises(ValueError, match="learned for another spec: its cell_size is "):
        learn_views(mesh, other, FEW)
    with pytest.raises(ValueError, match="must have 1…10 rows and columns of cells here, got 11x11"):
        learn_views(mesh, background, dataclasses.replace(FEW, size=(11, 11)))


def test_what_are_no_views(tmp_path: Path) -> None:
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"weights": np.zeros((4, 2, 2, 31), np.float16)}, "weights must be finite, torch.float32 of shape"),
        ({"scale": np.full(3, np.nan, np.float32)}, "must be finite"),
        ({"level": np.array([0, 1, 64])}, "in order of the views"),
        ({"first": np.array([0, 4, 3])}, "in order of the views"),
        ({"first": np.array([0, 1, 2])}, "in order of the views"),  # of three elements
    ]
    for changes, message in wrong:
        check_refused(tiny_models.views(), tmp_path / "v.npz", changes, message)


def test_views_are_stored_by_mesh_background_and_sampling(
    mesh: Mesh, background: Background, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ExemplarLibrary, "_read_or_learn", lambda library, mesh, key: key)
    replace = dataclasses.replace
    backgrounds = [
        background,
        replace(background, mean=background.mean * 1.1),
        replace(background, covariance=background.covariance * 1.1),
        replace(background, spec=replace(EXEMPLAR_SPEC, cell_size=(8, 8))),
    ]
    meshes = [
        replace(mesh, vertices=mesh.vertices * 0.9),
        replace(mesh, faces=mesh.faces.flip(0)),
        replace(mesh, brightness=mesh.brightness * 0.9),
    ]
    samplings = [replace(FEW, **{each.name: ()}) for each in dataclasses.fields(FEW)]  # type: ignore[arg-type]
    keys = [
        *(ExemplarLibrary(None, each, FEW).views(mesh) for each in backgrounds),
        *(ExemplarLibrary(None, background, FEW).views(each) for each in meshes),
        *(ExemplarLibrary(None, background, each).views(mesh) for each in samplings),
    ]
    assert len({*keys}) == len(keys)
    assert ExemplarLibrary(Path(), background, FEW).views(mesh) == keys[0]


def test_a_library_learns_each_model_once(
    tmp_path: Path, mesh: Mesh, background: Background, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def learn(mesh: Mesh, *options: Any) -> ExemplarViews:
        calls.append(mesh)
        return learn_views(mesh, *options)

    monkeypatch.setattr(learning, "learn_views", learn)
    folder = tmp_path / "new" / "library"
    one = ViewSampling(azimuths=(30,), elevations=(20,))
    library = ExemplarLibrary(folder, background, one)
    first = library.views(mesh)
    assert library.views(mesh) is first
    assert len(calls) == 1
    (path,) = folder.iterdir()

    again = ExemplarLibrary(folder, background, one).views(mesh)
    assert len(calls) == 1
    assert torch.equal(again.weights, first.weights)

    path.write_bytes(path.read_bytes()[:1000])
    assert torch.equal(ExemplarLibrary(folder, background, one).views(mesh).weights, first.weights)
    assert len(calls) == 2

    other = Mesh(mesh.vertices, mesh.faces, mesh.brightness * 0.9)
    for changed in (
        ExemplarLibrary(folder, background, one).views(other),
        ExemplarLibrary(folder, background, dataclasses.replace(one, count=3)).views(mesh),
        ExemplarLibrary(folder, dataclasses.replace(background, mean=background.mean * 1.1), one).views(mesh),
        ExemplarLibrary(None, background, one).views(mesh),
    ):
        assert not torch.equal(changed.weights, first.weights)
    assert len(calls) == 6
    assert len(list(folder.iterdir())) == 4


def test_a_model_that_is_not_seen(background: Background) -> None:
    """Smaller than a pixel's sample: no element, and no error."""
    speck = torch.tensor([[0, 0, 0], [1e-6, 0, 0], [0, 0, 1e-6]], dtype=torch.float64)
    mesh = Mesh(speck, torch.tensor([[0, 1, 2]]), torch.ones(3, dtype=torch.float64))
    views = learn_views(mesh, background, FEW)
    assert len(views.scale) == 0
    assert views.weights.shape == (0, 10, 10, 9)
    assert views.first.tolist() == [0, 0, 0]


def test_one_of_ten_thousand_patches_of_photographs_scores_0(background: Background, views: ExemplarViews) -> None:
    """The mean of photographs scores -1."""
    weights = views.weights[:8]
    scale, offset = calibration(weights, background)
    assert_close((weights * background.mean.float()).sum((1, 2, 3)) * scale + offset, -torch.ones(8), atol=1e-4, rtol=0)
    samples = [sample_photograph(name)[None] for name in ("astronaut", "camera", "coffee", "rocket")]
    maps = [
        conv2d(hog(each, EXEMPLAR_SPEC).permute(0, 3, 1, 2), weights.permute(0, 3, 1, 2))[0].flatten(1)
        for each in samples
    ]
    scores = scale[:, None] * torch.cat(maps, dim=1) + offset[:, None]
    assert scores.shape[1] > 9000
    assert abs(scores.mean() + 1) < 0.1
    assert abs(scores.quantile(0.9999, dim=1).mean()) < 0.3
