"""What is prepared for a photograph and a model, and kept."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch.testing import assert_close

from nablahog.hog import presets
from nablahog.hog.box import Box
from nablahog.pose.background import default_background
from nablahog.pose.crop import ObjectCrop, crop_object
from nablahog.pose.prepared import ELEMENT, ELEMENTS, PreparedPhotograph, pose_spec, prepared_model
from nablahog.pose.similarity import describe
from nablahog.render import Camera, render

from .common import columns, model, photographed


@pytest.fixture(scope="module")
def crop() -> ObjectCrop:
    return crop_object(*photographed(model(), 40, 15, behind="coffee"))


def test_the_default_descriptor() -> None:
    assert pose_spec() == presets.aubry(8, colour="gray")
    assert pose_spec(4).cell_size == (4, 4)


def test_elements_lie_in_the_box() -> None:
    image, _ = photographed(model(), 40, 15, behind="coffee")
    crop = crop_object(image, (70.0, 20.0, 130.0, 140.0))
    photograph = PreparedPhotograph(crop)
    assert photograph.background is default_background(pose_spec())
    descriptor, result = photograph.elements
    assert_close(descriptor, describe(crop.image, pose_spec())[0].permute(1, 2, 0))
    assert 5 < len(result) <= ELEMENTS
    for k, (row, col) in enumerate(result.positions.tolist()):
        assert torch.equal(result.patches[k], descriptor[row : row + ELEMENT[0], col : col + ELEMENT[1]])
    middles = (result.positions + torch.tensor(ELEMENT) / 2) * 8 - 64
    width, height = crop.size
    assert (middles[:, 1].abs() + 20 <= width / 2 + 8).all()
    assert (middles[:, 0].abs() + 20 <= height / 2 + 8).all()


def test_a_narrow_box_has_elements_of_its_middle() -> None:
    photograph = PreparedPhotograph(crop_object(torch.rand(1, 100, 100), (40.0, 0.0, 50.0, 100.0)))
    _, result = photograph.elements
    assert len(result) > 0
    assert ((result.positions[:, 1] - 5.5).abs() <= 1).all()


def test_what_is_beyond_the_photograph_does_not_count() -> None:
    """Its border repeats there, as streaks that the descriptor sees."""
    crop = crop_object(torch.rand(1, 112, 60), (0.0, 0.0, 60.0, 112.0))
    image = crop.image.clone()
    image[..., :18] = torch.rand(18)  # the photograph begins at 34; a cell's own votes reach 12 pixels from its middle
    other = dataclasses.replace(crop, image=image)
    for template in ("calibrated", "fine"):
        result, expected = (getattr(PreparedPhotograph(each), template).weights for each in (other, crop))
        assert torch.equal(result, expected)
    everywhere = dataclasses.replace(crop, valid=Box(0.0, 0.0, 128.0, 128.0))
    assert not torch.allclose(
        PreparedPhotograph(everywhere).calibrated.weights, PreparedPhotograph(crop).calibrated.weights
    )


def test_templates_of_elements(crop: ObjectCrop) -> None:
    photograph = PreparedPhotograph(crop)
    descriptor, result = photograph.elements
    template = photograph.whitened
    assert template.whitener is None
    assert template.spec == pose_spec()
    assert_close(template.weights.permute(1, 2, 0), result.scatter(result.weights, *descriptor.shape[:2]))


def test_calibrated_templates_have_whole_and_half_cells(crop: ObjectCrop) -> None:
    photograph = PreparedPhotograph(crop)
    assert photograph.template("calibrated") is photograph.calibrated is photograph.calibrated
    assert photograph.calibrated.weights.shape == (9, 16, 16)
    assert photograph.fine.weights.shape == (9, 32, 32)
    assert photograph.fine is photograph.fine
    assert photograph.calibrated.whitener is PreparedPhotograph(crop).calibrated.whitener  # takes longer than the rest


def test_another_background_brings_its_descriptor(crop: ObjectCrop) -> None:
    background = default_background(presets.uoctti(16, colour="gray"), 4)
    photograph = PreparedPhotograph(crop, background)
    for template in (photograph.whitened, photograph.calibrated):
        assert template.spec is background.spec
        assert template.weights.shape == (31, 8, 8)


def test_a_model_is_prepared_once_for_a_camera(crop: ObjectCrop) -> None:
    prepared = prepared_model(model(), crop.camera)
    assert prepared_model(model(), crop.camera) is prepared
    template = PreparedPhotograph(crop).whitened
    renderers = [prepared.similarity(template, *options).renderer for options in ((), ("opendr",), ("edges", 2), ())]  # type: ignore[arg-type]
    assert renderers[0] is renderers[3]
    assert [(each.method, each.supersampling) for each in renderers[:3]] == [("edges", 1), ("opendr", 1), ("edges", 2)]
    assert all(each.camera == crop.camera for each in renderers)
    other = Camera(100.0, 64, 64)
    assert prepared_model(model(), other).camera == other


def test_less_detail_takes_fewer_faces(crop: ObjectCrop) -> None:
    template = PreparedPhotograph(crop).calibrated
    exact, coarse = (prepared_model(model(), crop.camera).similarity(template, detail=detail) for detail in (0.0, 4.0))
    assert len(coarse.renderer.mesh.faces) < 0.8 * len(exact.renderer.mesh.faces)
    poses = columns(torch.arange(0.0, 360, 15))
    assert torch.corrcoef(torch.stack([exact.values(poses), coarse.values(poses)]))[0, 1] > 0.9
    assert prepared_model(model(), crop.camera).similarity(template, detail=4.0).renderer is coarse.renderer


def test_similarities_are_of_its_renderings(crop: ObjectCrop) -> None:
    template = PreparedPhotograph(crop).whitened
    poses = columns(torch.tensor([30.0, 60]))
    similarity = prepared_model(model(), crop.camera).similarity(template, "edges", 2)
    images = render(model(), poses, crop.camera, supersampling=2)
    expected = (describe(images, template.spec) * template.weights).sum((1, 2, 3))
    assert_close(similarity.values(poses), expected.double(), rtol=1e-4, atol=1e-4)
