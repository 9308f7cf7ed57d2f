"""What is prepared for a photograph and a model, and kept: templates, renderers, views, and equal views."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from nablahog.hog import presets
from nablahog.hog.box import Box
from nablahog.pose import estimate_pose
from nablahog.pose.background import default_background, pose_spec
from nablahog.pose.crop import FILL, ObjectCrop, crop_object, typical_camera
from nablahog.pose.model import (
    DETAIL,
    ELEVATION_STEP,
    VIEW_COUNT,
    PreparedModel,
    equidistant_azimuths,
    equivalent_azimuths,
    fit_to_box,
    level_poses,
    prepared_model,
    view_descriptors,
)
from nablahog.pose.photograph import ELEMENT, ELEMENTS, PreparedPhotograph
from nablahog.pose.similarity import describe
from nablahog.render import Camera, Mesh

from .common import columns, degrees_between, model, photographed


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
    assert photograph.calibrated.spec is background.spec
    assert photograph.calibrated.weights.shape == (31, 8, 8)


def test_a_model_is_prepared_once_for_a_camera(crop: ObjectCrop) -> None:
    prepared = prepared_model(model(), crop.camera)
    assert prepared_model(model(), crop.camera) is prepared
    template = PreparedPhotograph(crop).fine
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


# --- views ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def photograph(crop: ObjectCrop) -> PreparedPhotograph:
    return PreparedPhotograph(crop)


@pytest.fixture(scope="module")
def prepared(crop: ObjectCrop) -> PreparedModel:
    return prepared_model(model(), crop.camera)


def similarities(model: PreparedModel, photograph: PreparedPhotograph, elevation: float) -> torch.Tensor:
    views = view_descriptors(model, elevation)
    return (views.flatten(1) @ photograph.calibrated.weights.flatten()).double()


def test_views_have_the_similarities_of_renderings_that_fill_the_crop(
    photograph: PreparedPhotograph, prepared: PreparedModel
) -> None:
    poses = fit_to_box(level_poses(equidistant_azimuths(VIEW_COUNT), 15), prepared.hull, prepared.camera, FILL)
    expected = prepared.similarity(photograph.calibrated, detail=DETAIL).values(poses)
    result = similarities(prepared, photograph, 15)
    assert_close(result, expected, rtol=1e-4, atol=1e-4)
    assert degrees_between(float(equidistant_azimuths(VIEW_COUNT)[result.argmax()]), 40) <= 360 / VIEW_COUNT


def test_elevations_are_those_next_to_the_one_asked_for(prepared: PreparedModel) -> None:
    expected = view_descriptors(prepared, 15)
    assert torch.equal(view_descriptors(prepared, 15 + 0.49 * ELEVATION_STEP), expected)
    assert not torch.equal(view_descriptors(prepared, 15 + 0.51 * ELEVATION_STEP), expected)
    for elevation in (-90.0, 90.0):
        assert torch.isfinite(view_descriptors(prepared, elevation)).all()


def bottle(sides: int = 32) -> Mesh:
    """A solid of revolution."""
    profile = [(0.0, -0.45), (0.12, -0.45), (0.12, 0.1), (0.04, 0.25), (0.04, 0.45), (0.0, 0.45)]
    turns = 2 * np.pi * np.arange(sides) / sides
    rings = [np.stack([r * np.cos(turns), r * np.sin(turns), np.full(sides, z)], 1) for r, z in profile]
    faces = []
    for ring in range(len(profile) - 1):
        for k in range(sides):
            a, b = ring * sides + k, ring * sides + (k + 1) % sides
            faces += [[a, b, b + sides], [a, b + sides, a + sides]]
    vertices = torch.from_numpy(np.concatenate(rings))
    return Mesh(vertices, torch.tensor(faces), torch.full((len(vertices),), 0.6, dtype=torch.float64))


def slab() -> Mesh:
    """A cuboid, which looks the same from behind."""
    vertices = torch.cartesian_prod(*(torch.tensor([-side, side]).double() for side in (0.4, 0.2, 0.25)))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))]
    return Mesh(vertices, torch.tensor(faces), torch.full((8,), 0.6, dtype=torch.float64))


def test_azimuths_from_which_a_model_looks_the_same() -> None:
    camera = typical_camera()
    assert len(equivalent_azimuths(prepared_model(bottle(), camera), 10, 15)) == 47
    assert equivalent_azimuths(prepared_model(slab(), camera), 20, 15) == (200,)
    assert equivalent_azimuths(prepared_model(model(), camera), 20, 15) == ()


def test_a_bottle_has_any_azimuth() -> None:
    image, box = photographed(bottle(), 30, 15, behind="coffee")
    estimate = estimate_pose(image, bottle(), box=box, initial=(0, 15))
    assert estimate.any_azimuth
    assert estimate.runners_up == ()
    assert "azimuth any" in repr(estimate)


def test_the_back_of_a_slab_is_no_other_pose() -> None:
    image, box = photographed(slab(), 30, 15, behind="coffee")
    estimate = estimate_pose(image, slab(), box=box, initial=(0, 15))
    assert not estimate.any_azimuth
    (other,) = estimate.equivalent_azimuths
    assert degrees_between(other, estimate.azimuth) == 180
    assert min(degrees_between(estimate.azimuth, each) for each in (30, 210)) < 4
    assert all(min(degrees_between(one.azimuth, each) for each in (30, 210)) > 15 for one in estimate.runners_up)
