"""The looks of other renderers, on objects whose shadows and highlights geometry tells."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog.paper.looks import compress_jpeg, relight
from nablahog.paper.scenes import scene
from nablahog.render import Camera, Light, Mesh, render, silhouette
from nablahog.render.camera import pose, to_camera, to_screen

from ..render.shapes import box, joined
from .test_scenes import CLEAN, MODELS, VIEWS

CAMERA = Camera(200.0, 120, 160)


def _mesh() -> Mesh:
    """A board on a post, 1.1 high."""
    post, board = box((0.1, 0.1, 1)), box((1, 1, 0.1))
    below, above = (
        Mesh(mesh.vertices + mesh.vertices.new_tensor((0, 0, z)), mesh.faces, mesh.brightness)
        for mesh, z in ((post, -0.05), (board, 0.5))
    )
    return joined(below, above)


def _relit(mesh: Mesh, poses: torch.Tensor, light: Light, **strength: float) -> tuple[np.ndarray, ...]:
    """Before and after."""
    picture = render(mesh, poses, CAMERA, background=0.0, light=light)[0, 0].double().numpy()
    opacity = silhouette(mesh, poses, CAMERA)[0, 0].double().numpy()
    return picture, opacity, *relight(picture, opacity, mesh, poses[0], CAMERA, light, **strength)


def _pixel(point: tuple[float, float, float], poses: torch.Tensor) -> tuple[int, int]:
    """Row and column."""
    x, y, _ = to_screen(to_camera(torch.tensor([point], dtype=torch.float64), poses), poses, CAMERA)[0, 0].tolist()
    return int(y), int(x)


def test_shadow_on_the_floor_is_where_geometry_says() -> None:
    """The board is 1 above the floor, and the light comes at 45° from the left: its shadow is 1 to the right."""
    poses, light = pose(0, 20, 5), Light((-1, 0, 1), 0.4, 0.6)
    _, opacity, lit, dark = _relit(_mesh(), poses, light, shadow=1.0, gloss=0.0)
    inside, beside, left = (_pixel((x, 0.2, -0.55), poses) for x in (1.0, 1.8, -1.0))
    assert dark[inside] == pytest.approx(0.6, abs=0.01)  # only ambient light is left
    assert (dark[beside], dark[left]) == (0, 0)
    assert opacity[inside] == 0
    assert (dark >= opacity - 1e-9).all()
    assert np.allclose(lit[opacity == 0], 0)


def test_shadow_on_the_object_itself() -> None:
    """The post below the board is dark where the light comes from high above, and lit from the side."""
    poses, post = pose(0, 10, 5), (0.0, -0.05, 0.3)
    for direction, share in (((0, -0.3, 1), 1 / 3), ((0, -1, 0.01), 1.0)):
        light = Light(direction, 0.2, 0.8)
        picture, _, lit, _ = _relit(_mesh(), poses, light, shadow=1.0, gloss=0.0)
        at = _pixel(post, poses)
        if share == 1:
            assert lit[at] == pytest.approx(picture[at], abs=1e-3)
        else:
            assert lit[at] == pytest.approx(0.2 * 0.8, abs=0.01)  # ambient light times the brightness
            assert lit[at] < picture[at]
        assert (lit <= picture + 1e-6).all()


def test_seen_from_below_there_is_no_floor() -> None:
    _, opacity, _, dark = _relit(_mesh(), pose(0, -20, 5), Light((-1, 0, 1), 0.4, 0.6), shadow=1.0, gloss=0.0)
    np.testing.assert_allclose(dark, opacity)


def test_highlight_where_the_light_is_mirrored() -> None:
    """The board's upper side mirrors a light that is as high behind it as the camera in front."""
    poses, at = pose(0, 40, 5), (0.0, 0.0, 0.55)
    high = np.tan(np.radians(40))
    for direction, bright in (((0, 1, high), True), ((0, -1, high), False)):
        picture, opacity, lit, _ = _relit(_mesh(), poses, Light(direction, 0.4, 0.6), shadow=0.0, gloss=0.3)
        more = lit[_pixel(at, poses)] - picture[_pixel(at, poses)]
        assert (more > 0.2) == bright
        assert (lit >= picture - 1e-6).all()
        assert (lit <= opacity + 1e-6).all()


def test_compression_is_that_of_pillow() -> None:
    levels = np.random.default_rng(0).integers(0, 256, (40, 30, 3), dtype=np.uint8)
    file = io.BytesIO()
    Image.fromarray(levels).save(file, "JPEG", quality=30)
    expected = np.asarray(Image.open(file)).transpose(2, 0, 1) / 255
    np.testing.assert_array_equal(compress_jpeg(levels.transpose(2, 0, 1) / 255, 30), expected)


def test_scenes_with_looks() -> None:
    """Where there is a shadow, the background is darker; the object's pose stays."""
    lit = replace(CLEAN, contrast=(1, 1), ambient=(0.3, 0.3))
    plain, shaded = (
        scene(0, {"tower": MODELS["tower"]}, VIEWS[:1], [np.ones((90, 120))], settings=settings)
        for settings in (lit, replace(lit, shadow=1))
    )
    assert torch.equal(plain.pose, shaded.pose)
    coverage = silhouette(MODELS["tower"], plain.pose[None], plain.camera)[0, 0]
    beside = coverage == 0
    assert float(plain.image[0][beside].min()) == pytest.approx(1, abs=1e-3)
    assert 0.25 < float(shaded.image[0][beside].min()) < 0.5
    files = [scene(0, MODELS, VIEWS, [np.ones((90, 120))], settings=replace(CLEAN, jpeg=(q, q))) for q in (10, 90)]
    assert not torch.equal(files[0].image, files[1].image)
