"""The paper's similarity: ∇HOG of each patch as an image of its own, and its gradient."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.box import Box
from nablahog.pose.background import default_background
from nablahog.pose.crop import ObjectCrop, crop_object
from nablahog.pose.patches import PatchTemplate, patch_template
from nablahog.pose.prepared import ELEMENT, PreparedPhotograph, patch_spec
from nablahog.pose.similarity import Similarity
from nablahog.render import Renderer

from .common import columns, model, photographed

REGIONS = (Box(0, 0, 24, 16), Box(8, 4, 32, 20), Box(16, 24, 40, 40))  # the first two overlap
FORMS = [presets.paper(), presets.paper(global_form="robust", epsilon=0.1)]


@pytest.fixture(scope="module")
def crop() -> ObjectCrop:
    return crop_object(*photographed(model(), 40, 15, behind="coffee"))


def by_patches(photograph: Tensor, rendering: Tensor, regions: tuple[Box, ...], spec: HOGSpec) -> Tensor:
    """Σ ⟨φ(P_I), φ(P_f)⟩ in a plain loop over the cut-outs of two images (H, W)."""
    total = rendering.new_zeros(())
    for x0, y0, x1, y1 in regions:
        p_i, p_f = (hog(image[y0:y1, x0:x1].contiguous()[None, None], spec) for image in (photograph, rendering))
        total = total + (p_i * p_f).sum()
    return total


def _template(photograph: Tensor, spec: HOGSpec) -> PatchTemplate:
    return patch_template(photograph[None, None], REGIONS, spec)


@pytest.mark.parametrize("spec", FORMS, ids=["printed", "robust"])
def test_a_loop_over_patches(spec: HOGSpec) -> None:
    photograph, *renderings = torch.rand(5, 40, 40, dtype=torch.float64)
    batch = torch.stack(renderings)[:, None]
    template = _template(photograph, spec)
    expected = torch.stack([by_patches(photograph, rendering, REGIONS, spec) for rendering in renderings])
    assert_close(template.similarities(batch), expected)
    assert_close(template.similarities_and_gradients(batch)[0], expected)


@pytest.mark.parametrize("spec", FORMS, ids=["printed", "robust"])
def test_every_patch_has_its_own_normaliser(spec: HOGSpec) -> None:
    """What lies beside a patch makes no difference to it, as it would if the whole image had one normaliser."""
    photograph, rendering = torch.rand(2, 40, 40, dtype=torch.float64)
    alone = PatchTemplate(spec, REGIONS[2:], _template(photograph, spec).descriptors[2:])
    value = alone.similarities(rendering[None, None])
    rendering[:20] = 0
    assert torch.equal(alone.similarities(rendering[None, None]), value)
    if spec == FORMS[1]:  # of unit length: contrast hardly counts, and a patch is most like itself
        faint = 0.5 + 0.5 * (rendering - 0.5)
        assert_close(alone.similarities(faint[None, None]), value, rtol=1e-3, atol=0)
        whole = _template(photograph, spec).similarities(photograph[None, None])
        assert float(whole) == pytest.approx(len(REGIONS), rel=1e-3)


@pytest.mark.parametrize("spec", FORMS, ids=["printed", "robust"])
def test_gradients_are_central_differences(spec: HOGSpec) -> None:
    photograph, rendering = torch.rand(2, 40, 40, dtype=torch.float64)
    template, step = _template(photograph, spec), 1e-7
    _, gradient = template.similarities_and_gradients(rendering[None, None])
    for _ in range(10):
        way = torch.randn_like(rendering)[None, None]
        high, low = (template.similarities(rendering + sign * step * way) for sign in (1, -1))
        assert_close((gradient * way).sum(), ((high - low) / (2 * step))[0], rtol=1e-5, atol=1e-6)
    assert not gradient[0, 0, 20:, :16].any()  # in no region
    assert gradient[0, 0, 4:16, 8:24].all()  # in two


def test_regions_are_those_of_the_visual_elements(crop: ObjectCrop) -> None:
    photograph = PreparedPhotograph(crop)
    _, elements = photograph.elements
    template = photograph.patches
    assert photograph.template("patches") is template
    assert template.spec == patch_spec((8, 8)) == presets.paper(8, global_form="robust", epsilon=0.1)
    assert template.descriptors.shape == (len(elements), *ELEMENT, 9)
    for region, (row, col) in zip(template.regions, elements.positions.tolist(), strict=True):
        assert region == (8 * col, 8 * row, 8 * col + 40, 8 * row + 40)
    image = crop.image[0, 0]
    assert_close(template.similarities(crop.image)[0], by_patches(image, image, template.regions, template.spec))


def test_elements_of_larger_cells_have_larger_patches(crop: ObjectCrop) -> None:
    background = default_background(presets.uoctti(16, colour="gray"), 4)
    template = PreparedPhotograph(crop, background).patches
    assert {(region.width, region.height) for region in template.regions} == {(80, 80)}
    assert template.spec.cell_size == (16, 16)
    assert template.descriptors.shape[1:] == (*ELEMENT, 9)


def test_crops_without_elements_are_refused(crop: ObjectCrop) -> None:
    background = default_background(presets.uoctti(32, colour="gray"), 4)
    with pytest.raises(ValueError, match="visual elements have 5x5 cells, but the object only 4x4"):
        PreparedPhotograph(crop, background).template("patches")


@pytest.mark.parametrize("method", ["edges", "opendr"])
def test_derivatives_by_the_pose_are_autograds(crop: ObjectCrop, method: str) -> None:
    """The whole chain, from the pose through the renderer and φ of each patch to the sum."""
    template = PreparedPhotograph(crop).patches
    renderer = Renderer(model(), crop.camera, method=method, supersampling=1)  # type: ignore[arg-type]
    poses = columns(torch.tensor([20.0, 40, 200])).requires_grad_(True)
    images = renderer(poses)
    values = torch.stack([by_patches(crop.image[0, 0], image[0], template.regions, template.spec) for image in images])
    (expected,) = torch.autograd.grad(values.sum(), poses)
    of = Similarity(renderer, template)
    value, slopes = of.derivatives(poses.detach())
    assert_close(value, values.double(), rtol=1e-4, atol=1e-4)
    assert_close(slopes, expected, rtol=0, atol=1e-3 * float(expected.abs().max()))
    assert_close(of.values(poses.detach()), value, rtol=1e-5, atol=1e-6)


def test_an_empty_rendering_is_like_nothing(crop: ObjectCrop) -> None:
    values, gradients = PreparedPhotograph(crop).patches.similarities_and_gradients(torch.ones(2, 1, 128, 128))
    assert values.tolist() == [0, 0]
    assert torch.isfinite(gradients).all()


def test_it_is_highest_at_the_true_azimuth(crop: ObjectCrop) -> None:
    of = Similarity(Renderer(model(), crop.camera, supersampling=2), PreparedPhotograph(crop).patches)
    azimuths = torch.arange(0.0, 360, 10)
    assert float(azimuths[of.values(columns(azimuths)).argmax()]) == pytest.approx(40, abs=10)
