"""Similarities: what they add up, what they are invariant to, and their derivatives."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import hog
from nablahog.pose.crop import ObjectCrop, crop_object, downsampled
from nablahog.pose.elements import elements
from nablahog.pose.prepared import PreparedPhotograph, SimilarityKind
from nablahog.pose.similarity import ElementTemplate, Similarity, describe, downsampled_poses, whitened_template
from nablahog.render import Camera, Renderer, render

from .common import columns, model, photographed

KINDS: tuple[SimilarityKind, ...] = ("whitened", "calibrated")  # of patches: test_patches.py


@pytest.fixture(scope="module")
def crop() -> ObjectCrop:
    return crop_object(*photographed(model(), 40, 15, behind="coffee"))


@pytest.fixture(scope="module")
def photograph(crop: ObjectCrop) -> PreparedPhotograph:
    return PreparedPhotograph(crop)


def camera_of(photograph: PreparedPhotograph, kind: SimilarityKind) -> Camera:
    return downsampled(photograph.crop.camera, photograph.template(kind).shrink)


def similarity(photograph: PreparedPhotograph, kind: SimilarityKind, supersampling: int = 1) -> Similarity:
    renderer = Renderer(model(), camera_of(photograph, kind), supersampling=supersampling)
    return Similarity(renderer, photograph.template(kind))


def template_of(photograph: PreparedPhotograph, kind: SimilarityKind) -> ElementTemplate:
    return photograph.whitened if kind == "whitened" else photograph.calibrated


def some(template: ElementTemplate, count: int = 3) -> Tensor:
    return torch.rand(count, *template.weights.shape)


def test_descriptors_are_those_of_the_operator(crop: ObjectCrop, photograph: PreparedPhotograph) -> None:
    spec = photograph.background.spec
    assert_close(describe(crop.image, spec).permute(0, 2, 3, 1), hog(crop.image, spec))


def test_elements_add_up_in_one_template(crop: ObjectCrop, photograph: PreparedPhotograph) -> None:
    spec = photograph.background.spec
    (descriptor,) = hog(crop.image, spec)
    result = elements(descriptor, photograph.background, (4, 3), count=9)
    assert len(result) == 9
    renderings = torch.rand(4, *descriptor.shape)
    template = whitened_template(result, spec, *descriptor.shape[:2])
    values, slopes = template.values_and_gradients(renderings.permute(0, 3, 1, 2))
    assert_close(values, (result.gather(renderings) * result.weights).sum((1, 2, 3, 4)), rtol=1e-4, atol=1e-4)
    assert (slopes == template.weights).all()


def test_calibrated_is_the_score_of_the_renderings_discriminant(
    photograph: PreparedPhotograph, crop: ObjectCrop
) -> None:
    """w = Σ⁻¹ q of the rendering, on the photograph, in standard deviations √(wᵀ Σ w)."""
    template = photograph.calibrated
    assert template.whitener is not None
    assert template.shrink == 2
    q = some(template)
    w = template.whitener(q)
    x = template.whitener.centred(describe(crop.downsampled(2).image, template.spec))
    deviation = (w * q).sum((1, 2, 3)).sqrt()  # Σ w is q again
    assert_close(template.values_and_gradients(q)[0], (w * x).sum((1, 2, 3)) / deviation, rtol=1e-3, atol=1e-3)


def test_calibrated_does_not_depend_on_contrast(photograph: PreparedPhotograph) -> None:
    template = photograph.calibrated
    q = some(template)
    values, slopes = template.values_and_gradients(q)
    scaled, flatter = template.values_and_gradients(7 * q)
    assert_close(scaled, values, rtol=1e-4, atol=1e-4)
    assert_close(7 * flatter, slopes, rtol=1e-3, atol=1e-4)
    assert (slopes * q).sum((1, 2, 3)).abs().max() < 1e-3 * (slopes.norm() * q.norm())


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_the_descriptor(photograph: PreparedPhotograph, kind: SimilarityKind) -> None:
    template = template_of(photograph, kind)
    q = some(template, 5)
    way = torch.randn_like(q)
    difference = template.values_and_gradients(q + 0.01 * way)[0] - template.values_and_gradients(q - 0.01 * way)[0]
    slopes = template.values_and_gradients(q)[1]
    expected = (slopes * way).sum((1, 2, 3)) * 0.02
    assert_close(difference, expected, rtol=1e-2, atol=1e-2 * float(expected.abs().max()))


@pytest.mark.parametrize("kind", KINDS)
def test_values_alone_are_the_same(photograph: PreparedPhotograph, kind: SimilarityKind) -> None:
    template = template_of(photograph, kind)
    q = some(template, 5)
    assert_close(template.values(q), template.values_and_gradients(q)[0], rtol=1e-4, atol=1e-4)
    assert template.values(torch.zeros_like(q)).tolist() == [0] * 5


def test_an_empty_rendering_is_like_nothing(photograph: PreparedPhotograph) -> None:
    for kind in KINDS:
        template = template_of(photograph, kind)
        values, slopes = template.values_and_gradients(torch.zeros(2, *template.weights.shape))
        assert values.tolist() == [0, 0]
        assert torch.isfinite(slopes).all()
    assert not slopes.any()


@pytest.mark.parametrize("method", ["edges", "opendr"])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_the_pose_are_the_chain_rules(
    photograph: PreparedPhotograph, kind: SimilarityKind, method: str
) -> None:
    """Through images that are rendered on white, whose derivatives have tests of their own."""
    renderer = Renderer(model(), camera_of(photograph, kind), method=method, supersampling=1)  # type: ignore[arg-type]
    template = template_of(photograph, kind)
    of = Similarity(renderer, template)
    poses = columns(torch.tensor([10.0, 100, 200]))
    poses[:, 4:] = torch.tensor([5.0, -3.0])
    poses.requires_grad_(True)
    values, slopes = of.derivatives(poses.detach())
    descriptors = describe(renderer(downsampled_poses(poses, template.shrink)), template.spec)
    expected, by_descriptor = template.values_and_gradients(descriptors.detach())
    (by_pose,) = torch.autograd.grad(descriptors, poses, by_descriptor)
    assert_close(values, expected.double(), rtol=1e-4, atol=1e-4)
    assert_close(slopes, by_pose, rtol=0, atol=1e-3 * float(by_pose.abs().max()))
    assert_close(of.values(poses.detach()), values, rtol=1e-5, atol=1e-6)  # summed in another order


@pytest.mark.parametrize(("kind", "least"), [("patches", 0.85), ("whitened", 0.7), ("calibrated", 0.75)])
def test_derivatives_by_azimuth_are_about_the_slopes_of_fine_renderings(
    photograph: PreparedPhotograph, kind: SimilarityKind, least: float
) -> None:
    """Not exactly: all similarities are jagged below a degree, and the whitened ones most."""
    azimuths = torch.arange(3.0, 360, 20)
    step = 0.1
    of, fine = similarity(photograph, kind, 4), similarity(photograph, kind, 12)
    slopes = of.derivatives(columns(azimuths))[1][:, 0]
    expected = (fine.values(columns(azimuths + step)) - fine.values(columns(azimuths - step))) / (2 * step)
    assert torch.cosine_similarity(slopes, expected, dim=0) > least
    assert slopes.norm() / expected.norm() == pytest.approx(1, abs=0.3)


def test_many_poses_are_as_good_as_one(photograph: PreparedPhotograph) -> None:
    of = similarity(photograph, "calibrated")
    poses = columns(torch.linspace(0, 340, 35))
    values, slopes = of.derivatives(poses)
    assert of.renderings == 35
    assert_close(of.values(poses), values, rtol=1e-5, atol=1e-6)  # summed in another order
    assert of.renderings == 70
    for k in (0, 15, 16, 34):
        value, slope = of.derivatives(poses[k : k + 1])
        assert_close((values[k : k + 1], slopes[k : k + 1]), (value, slope), rtol=1e-4, atol=1e-4)
    camera = camera_of(photograph, "calibrated")
    image = render(model(), downsampled_poses(poses[3:4], 2), camera, supersampling=1)
    assert_close(values[3], of.template.similarities(image)[0].double(), rtol=1e-4, atol=1e-4)


def test_values_do_not_depend_on_the_number_of_threads(photograph: PreparedPhotograph) -> None:
    of = similarity(photograph, "calibrated")
    poses = columns(torch.linspace(0, 340, 35))
    one = of.derivatives(poses)
    torch.set_num_threads(2)
    try:
        two = of.derivatives(poses)
    finally:
        torch.set_num_threads(1)
    assert_close(two, one, rtol=1e-6, atol=1e-6)
