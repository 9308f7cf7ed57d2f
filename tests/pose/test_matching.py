"""What is prepared for a photograph and a model, and kept."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch.testing import assert_close

from nablahog.hog import presets
from nablahog.pose.background import default_background
from nablahog.pose.canvas import Canvas, cut_out
from nablahog.pose.matching import ELEMENT, ELEMENTS, Photograph, model_of, pose_spec
from nablahog.pose.similarity import describe
from nablahog.render import Camera, render

from .common import columns, model, photographed


@pytest.fixture(scope="module")
def canvas() -> Canvas:
    return cut_out(*photographed(model(), 40, 15, behind="coffee"))


def test_the_default_descriptor() -> None:
    assert pose_spec() == presets.aubry(8, colour="gray")
    assert pose_spec(4).cell_size == (4, 4)


def test_elements_lie_in_the_box() -> None:
    image, _ = photographed(model(), 40, 15, behind="coffee")
    canvas = cut_out(image, (70.0, 20.0, 130.0, 140.0))
    photograph = Photograph(canvas)
    assert photograph.background is default_background(pose_spec())
    descriptor, found = photograph.elements
    assert_close(descriptor, describe(canvas.image, pose_spec())[0].permute(1, 2, 0))
    assert 5 < len(found) <= ELEMENTS
    for k, (row, col) in enumerate(found.positions.tolist()):
        assert torch.equal(found.patches[k], descriptor[row : row + ELEMENT[0], col : col + ELEMENT[1]])
    middles = (found.positions + torch.tensor(ELEMENT) / 2) * 8 - 64
    width, height = canvas.size
    assert (middles[:, 1].abs() + 20 <= width / 2 + 8).all()
    assert (middles[:, 0].abs() + 20 <= height / 2 + 8).all()


def test_a_narrow_box_has_elements_of_its_middle() -> None:
    photograph = Photograph(cut_out(torch.rand(1, 100, 100), (40.0, 0.0, 50.0, 100.0)))
    _, found = photograph.elements
    assert len(found) > 0
    assert ((found.positions[:, 1] - 5.5).abs() <= 1).all()


def test_what_is_beyond_the_photograph_does_not_count() -> None:
    """Its border repeats there, as streaks that the descriptor sees."""
    canvas = cut_out(torch.rand(1, 112, 60), (0.0, 0.0, 60.0, 112.0))
    image = canvas.image.clone()
    image[..., :18] = torch.rand(18)  # the photograph begins at 34; a cell's own votes reach 12 pixels from its middle
    other = dataclasses.replace(canvas, image=image)
    for template in ("calibrated", "fine"):
        found, expected = (getattr(Photograph(each), template).weights for each in (other, canvas))
        assert torch.equal(found, expected)
    everywhere = dataclasses.replace(canvas, seen=(0.0, 0.0, 128.0, 128.0))
    assert not torch.allclose(Photograph(everywhere).calibrated.weights, Photograph(canvas).calibrated.weights)


def test_templates_of_elements(canvas: Canvas) -> None:
    photograph = Photograph(canvas)
    descriptor, found = photograph.elements
    for kind, patches in (("dot", found.patches), ("whitened", found.weights)):
        template = photograph.template(kind)  # type: ignore[arg-type]
        assert template.whitener is None
        assert template.spec == pose_spec()
        assert_close(template.weights.permute(1, 2, 0), found.spread(patches, *descriptor.shape[:2]))


def test_calibrated_templates_have_whole_and_half_cells(canvas: Canvas) -> None:
    photograph = Photograph(canvas)
    assert photograph.template("calibrated") is photograph.calibrated is photograph.calibrated
    assert photograph.calibrated.weights.shape == (9, 16, 16)
    assert photograph.fine.weights.shape == (9, 32, 32)
    assert photograph.fine is photograph.fine
    assert photograph.calibrated.whitener is Photograph(canvas).calibrated.whitener  # takes longer than the rest


def test_another_background_brings_its_descriptor(canvas: Canvas) -> None:
    background = default_background(presets.uoctti(16, colour="gray"), 4)
    photograph = Photograph(canvas, background)
    for kind in ("dot", "whitened", "calibrated"):
        template = photograph.template(kind)  # type: ignore[arg-type]
        assert template.spec is background.spec
        assert template.weights.shape == (31, 8, 8)


def test_a_model_is_prepared_once_for_a_camera(canvas: Canvas) -> None:
    prepared = model_of(model(), canvas.camera)
    assert model_of(model(), canvas.camera) is prepared
    template = Photograph(canvas).template("dot")
    renderers = [prepared.similarity(template, *options).renderer for options in ((), ("opendr",), ("edges", 2), ())]  # type: ignore[arg-type]
    assert renderers[0] is renderers[3]
    assert [(each.method, each.supersampling) for each in renderers[:3]] == [("edges", 1), ("opendr", 1), ("edges", 2)]
    assert all(each.camera == canvas.camera for each in renderers)
    other = Camera(100.0, 64, 64)
    assert model_of(model(), other).camera == other


def test_less_detail_takes_fewer_faces(canvas: Canvas) -> None:
    template = Photograph(canvas).calibrated
    exact, coarse = (model_of(model(), canvas.camera).similarity(template, detail=detail) for detail in (0.0, 4.0))
    assert len(coarse.renderer.mesh.faces) < 0.8 * len(exact.renderer.mesh.faces)
    poses = columns(torch.arange(0.0, 360, 15))
    assert torch.corrcoef(torch.stack([exact.values(poses), coarse.values(poses)]))[0, 1] > 0.9
    assert model_of(model(), canvas.camera).similarity(template, detail=4.0).renderer is coarse.renderer


def test_similarities_are_of_its_renderings(canvas: Canvas) -> None:
    template = Photograph(canvas).template("dot")
    poses = columns(torch.tensor([30.0, 60]))
    similarity = model_of(model(), canvas.camera).similarity(template, "edges", 2)
    images = render(model(), poses, canvas.camera, supersampling=2)
    expected = (describe(images, template.spec) * template.weights).sum((1, 2, 3))
    assert_close(similarity.values(poses), expected.double(), rtol=1e-4, atol=1e-4)
