"""Models and photographs: poses that fill a box, what is prepared of them, and views that look the same."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import presets
from nablahog.inputs.boxes import Box
from nablahog.pose import estimate_pose
from nablahog.pose.background import default_background, pose_spec
from nablahog.pose.crop import CROP_FILL, ObjectCrop, crop_object
from nablahog.pose.model import (
    DETAIL,
    ELEVATION_STEP,
    VIEW_COUNT,
    PreparedModel,
    azimuth_distance,
    convex_hull,
    equidistant_azimuths,
    fit_to_box,
    level_poses,
    local_maxima,
    prepared_model,
    reverse_depth,
    view_descriptors,
)
from nablahog.pose.photograph import ELEMENT, ELEMENTS, PreparedPhotograph
from nablahog.pose.similarity import describe
from nablahog.pose.symmetry import compare_sides
from nablahog.render import Camera, Mesh, pose, silhouette
from nablahog.render.camera import to_camera, to_screen

from ..chairs import chair
from ..render.shapes import box as cuboid
from ..render.shapes import cylinder, joined
from .common import columns, degrees_between, model, overlap, photographed

CAMERA = Camera(400.0, 128, 160)


def around(points: Tensor, poses: Tensor) -> tuple[Tensor, Tensor]:
    """The corners (B, 2) of the boxes around the points' projections."""
    screen = to_screen(to_camera(points, poses), poses, CAMERA)[..., :2]
    return screen.amin(1), screen.amax(1)


def views() -> Tensor:
    azimuths = torch.arange(0.0, 360, 40, dtype=torch.float64)
    poses = torch.tensor([0.0, 25, 3, 0, 0, 0], dtype=torch.float64).repeat(len(azimuths), 1)
    poses[:, 0] = azimuths
    poses[:, 3] = torch.linspace(-10, 10, len(azimuths))
    poses[:, 4:] = torch.rand(len(azimuths), 2, dtype=torch.float64) * 20
    return poses


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return chair(2)


def test_the_hull_decides_the_box(mesh: Mesh) -> None:
    points, poses = convex_hull(mesh), views()
    assert len(points) < len(mesh.vertices) / 2
    for few, all_of_them in zip(around(points, poses), around(mesh.vertices, poses), strict=True):
        assert_close(few, all_of_them)


@pytest.mark.parametrize("size", [(112.0, 60.0), (30.0, 80.0), (10.0, 10.0)])
def test_area_and_middle_are_those_of_the_box(mesh: Mesh, size: tuple[float, float]) -> None:
    poses = views()
    before = poses.clone()
    placed = fit_to_box(poses, convex_hull(mesh), CAMERA, size)
    assert torch.equal(poses, before)
    assert torch.equal(placed[:, [0, 1, 3]], before[:, [0, 1, 3]])
    low, high = around(mesh.vertices, placed)
    assert_close((high - low).prod(1), torch.full_like(low[:, 0], size[0] * size[1]), rtol=0.005, atol=0)
    assert_close((low + high) / 2, torch.tensor([[80.0, 64.0]]).expand(len(low), -1).double(), rtol=0, atol=1e-3)


def test_the_longer_side_is_the_one_given(mesh: Mesh) -> None:
    poses = fit_to_box(level_poses(torch.arange(0.0, 360, 40), 25), convex_hull(mesh), CAMERA, 90.0)
    low, high = around(mesh.vertices, poses)
    assert_close((high - low).amax(1), torch.full_like(low[:, 0], 90), rtol=0.005, atol=0)
    assert_close((low + high) / 2, torch.tensor([[80.0, 64.0]]).expand(len(low), -1).double(), rtol=0, atol=1e-3)


def test_it_comes_no_closer_than_a_diagonal(mesh: Mesh) -> None:
    placed = fit_to_box(views(), convex_hull(mesh), CAMERA, (2000.0, 2000.0))
    assert (placed[:, 2] == 1).all()
    low, high = around(mesh.vertices, placed)
    assert_close((low + high) / 2, torch.tensor([[80.0, 64.0]]).expand(len(low), -1).double())


@pytest.mark.parametrize("corners", [3, 4])
def test_of_flat_meshes_all_corners_count(corners: int) -> None:
    vertices = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1]], dtype=torch.float64)[:corners]
    flat = Mesh(vertices, torch.tensor([[0, 1, 2]]), torch.ones(corners, dtype=torch.float64)).normalized()
    half = 0.5**1.5
    assert_close(convex_hull(flat), torch.tensor([[-half, 0, -half], [-half, 0, half], [half, 0, -half]]).double())
    edge_on = torch.tensor([[90.0, 0, 3, 0, 0, 0]], dtype=torch.float64)
    assert torch.isfinite(fit_to_box(edge_on, convex_hull(flat), CAMERA, (100.0, 50.0))).all()


def test_a_pose_with_reversed_depth_has_the_same_outline_from_far_away() -> None:
    far = Camera(40 * 110.0, 128, 128)
    (seen_from,) = pose(70, 20, 40, 25, 3, -2)
    reversed_pose = reverse_depth(seen_from)
    turned = seen_from.clone()
    turned[0] = reversed_pose[0]
    outline, same, other = (silhouette(model(), at[None], far)[0, 0] > 0.5 for at in (seen_from, reversed_pose, turned))
    assert overlap(outline, same) > 0.95 > 0.8 > overlap(outline, other)


def test_distances_go_round() -> None:
    assert azimuth_distance(350, 20) == azimuth_distance(20, 350) == azimuth_distance(380, -10) == 30
    assert azimuth_distance(0, 180) == 180


@pytest.mark.parametrize(
    ("values", "count", "expected"),
    [
        ([1, 5, 2, 3, 9, 0, 4, 3], 9, [4, 1, 6]),
        ([1, 5, 2, 3, 9, 0, 4, 3], 2, [4, 1]),
        ([9, 5, 2, 3, 1, 8], 3, [0, 3]),  # the last is beside the first
        ([0, 1, 2, 3], 3, [3]),
        ([4], 3, [0]),
    ],
)
def test_local_maxima(values: list[float], count: int, expected: list[int]) -> None:
    assert local_maxima(torch.tensor(values).double(), count).tolist() == expected


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


def test_a_model_is_prepared_once(crop: ObjectCrop) -> None:
    prepared = prepared_model(model())
    assert prepared_model(model()) is prepared
    template = PreparedPhotograph(crop).fine
    renderers = [prepared.similarity(template, *options).renderer for options in ((), ("opendr",), ("edges", 2), ())]  # type: ignore[arg-type]
    assert renderers[0] is renderers[3]
    assert [(each.method, each.supersampling) for each in renderers[:3]] == [("edges", 1), ("opendr", 1), ("edges", 2)]
    assert all(each.camera == crop.camera for each in renderers)
    other = Camera(100.0, 128, 128)
    assert prepared.similarity(template, camera=other).renderer.camera == other


def test_less_detail_takes_fewer_faces(crop: ObjectCrop) -> None:
    template = PreparedPhotograph(crop).calibrated
    exact, coarse = (prepared_model(model()).similarity(template, detail=detail) for detail in (0.0, 4.0))
    assert len(coarse.renderer.mesh.faces) < 0.8 * len(exact.renderer.mesh.faces)
    poses = columns(torch.arange(0.0, 360, 15))
    assert torch.corrcoef(torch.stack([exact.values(poses), coarse.values(poses)]))[0, 1] > 0.9
    assert prepared_model(model()).similarity(template, detail=4.0).renderer is coarse.renderer


# --- views ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def prepared(crop: ObjectCrop) -> PreparedModel:
    return prepared_model(model())


BOTTLE, SLAB = cylinder(32), cuboid((0.8, 0.4, 0.5), 0.6)  # a solid of revolution, and what looks the same from behind


def moved(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    return dataclasses.replace(mesh, vertices=mesh.vertices + torch.tensor([x, y, z], dtype=torch.float64))


def similarities(model: PreparedModel, photograph: PreparedPhotograph, elevation: float) -> torch.Tensor:
    views = view_descriptors(model, elevation)
    return (views.flatten(1) @ photograph.calibrated.weights.flatten()).double()


def test_views_have_the_similarities_of_renderings_that_fill_the_crop(
    photograph: PreparedPhotograph, prepared: PreparedModel
) -> None:
    poses = fit_to_box(level_poses(equidistant_azimuths(VIEW_COUNT), 15), prepared.hull, prepared.camera, CROP_FILL)
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


def test_azimuths_from_which_a_model_looks_the_same() -> None:
    assert len(compare_sides(prepared_model(BOTTLE), 10, 15).equivalent) == 47
    assert compare_sides(prepared_model(SLAB), 20, 15) == ((200,), ())
    assert compare_sides(prepared_model(model()), 20, 15) == ((), ())


def test_a_drawer_tells_the_front_of_a_table() -> None:
    """Views with large cells are nearly alike; a door is as thin as two pixels, and its sides are still the same."""
    legs = [moved(cuboid((0.05, 0.05, 0.7)), x, y, -0.37) for x in (-0.4, 0.4) for y in (-0.2, 0.2)]
    table = joined(cuboid((1, 0.6, 0.05)), *legs)
    drawers = joined(table, moved(cuboid((0.2, 0.02, 0.08)), 0, -0.3, -0.1))
    table, drawers, door = (prepared_model(mesh.normalized()) for mesh in (table, drawers, cuboid((1, 0.02, 1.5))))
    for azimuth in (20.0, 60.0, 200.0):
        behind = ((azimuth + 180) % 360,)
        assert compare_sides(table, azimuth, 23) == compare_sides(door, azimuth, 23) == (behind, ())
        assert compare_sides(drawers, azimuth, 23) == ((), behind)


def test_turns_after_which_a_model_looks_the_same() -> None:
    """Also where the axis is not in the middle of the bounding box, and turns are no multiple of those of the views."""
    half_dark = cuboid((0.5, 0.5, 1))
    half_dark.brightness[4:] = 0.3
    for order, mesh in {1: half_dark, 3: cylinder(3), 4: cuboid((0.5, 0.5, 1)), 5: cylinder(5)}.items():
        turns = compare_sides(prepared_model(mesh.normalized()), 10, 20).equivalent
        assert sorted(turns) == pytest.approx(sorted((10 + 360 / order * k) % 360 for k in range(1, order)))


def test_a_bottle_has_any_azimuth() -> None:
    image, box = photographed(BOTTLE, 30, 15, behind="coffee")
    estimate = estimate_pose(image, BOTTLE, box=box, initial=(0, 15))
    assert estimate.any_azimuth
    assert estimate.runners_up == ()
    assert "azimuth any" in repr(estimate)


def test_the_back_of_a_slab_is_no_other_pose() -> None:
    image, box = photographed(SLAB, 30, 15, behind="coffee")
    estimate = estimate_pose(image, SLAB, box=box, initial=(0, 15))
    assert not estimate.any_azimuth
    (other,) = estimate.equivalent_azimuths
    assert degrees_between(other, estimate.azimuth) == 180
    assert min(degrees_between(estimate.azimuth, each) for each in (30, 210)) < 4
    assert estimate.runners_up
    assert all(min(degrees_between(one.azimuth, each) for each in (30, 210)) > 15 for one in estimate.runners_up)
