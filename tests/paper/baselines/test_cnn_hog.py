"""CNN-HOG against VLFeat's stored outputs, and its derivative against what its authors state."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.hog import hog, presets
from nablahog.paper.baselines import cnn_hog
from nablahog.paper.baselines.cnn_hog import CNNHOG
from tests.golden import Case, cases

VLFEAT = [
    case
    for case in cases("vlfeat")
    if case.pixels.ndim == 2 and case.parameters["variant"] == "uoctti" and case.parameters["cellSize"] == 8
]


@pytest.mark.parametrize("case", VLFEAT, ids=str)
def test_the_interior_equals_vlfeat(case: Case) -> None:
    bilinear = case.parameters["bilinearOrientations"]
    expected = case.output.transpose(1, 2, 0)[..., :27]
    rows, cols = (side // 8 for side in case.pixels.shape)
    image = case.image[..., : 8 * rows, : 8 * cols].double() / 255
    result = CNNHOG(8, bilinear=bilinear).descriptor(image)[0]
    # the outermost cells see the false border, and the next share blocks with them
    inside = slice(2, rows - 2), slice(2, cols - 2)
    assert np.abs(result[inside].numpy() - expected[inside]).max() < (1e-4 if bilinear else 1e-5)


def textured(*shape: int, seed: int = 0) -> Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.mark.parametrize(("cell_size", "orientations"), [(2, 4), (8, 9)])
@pytest.mark.parametrize("bilinear", [False, True])
def test_the_preset_is_the_networks_dialect(cell_size: int, orientations: int, bilinear: bool) -> None:
    """False edges and missing blocks included.  The network measures angles by an arccosine of 1 - 1e-7 at most."""
    net = CNNHOG(cell_size, orientations, bilinear=bilinear)
    image = textured(2, 1, 6 * cell_size, 5 * cell_size, seed=orientations)
    tolerance = 1e-4 if bilinear else 1e-6
    spec = presets.cnn_hog(cell_size, orientations=orientations, bilinear=bilinear)
    result = hog(image, spec)
    torch.testing.assert_close(result, net.descriptor(image), rtol=0, atol=tolerance)
    assert torch.equal(hog(image, spec, layout="native"), result.permute(0, 3, 1, 2))  # as the network lays it out


def test_bilinear_votes_have_their_own_derivative() -> None:
    image, net = textured(1, 1, 12, 16), CNNHOG(4, bilinear=True)
    result = torch.autograd.functional.jacobian(net.descriptor, image).reshape(-1, 192)
    steps = 1e-6 * torch.eye(192, dtype=torch.float64).reshape(192, 1, 1, 12, 16)
    columns = [(net.descriptor(image + step) - net.descriptor(image - step)).flatten() / 2e-6 for step in steps]
    # the 1e-7 under their root shows where a gradient points nearly along an orientation
    assert (result - torch.stack(columns, dim=1)).norm() < 2e-3 * result.norm()


def test_nearest_votes_have_the_derivative_of_the_magnitude() -> None:
    responses = (textured(1, 18, 5, 6, seed=1) - 0.5).requires_grad_()
    weights = textured(1, 18, 5, 6, seed=2)
    nearest = torch.zeros_like(responses).scatter_(1, responses.argmax(1, keepdim=True), 1)
    (expected,) = torch.autograd.grad(
        (weights * nearest * (responses.square().sum(1, keepdim=True) / 9).sqrt()).sum(), responses
    )
    (result,) = torch.autograd.grad((weights * cnn_hog._Nearest.apply(responses)).sum(), responses)
    torch.testing.assert_close(result, expected)


@pytest.mark.parametrize("bilinear", [False, True])
def test_a_constant_image_has_a_derivative(bilinear: bool) -> None:
    image = torch.full((1, 1, 32, 32), 0.5, requires_grad=True)
    CNNHOG(8, bilinear=bilinear).descriptor(image).sum().backward()
    assert image.grad is not None
    assert torch.isfinite(image.grad).all()


def test_the_objective_has_its_derivative() -> None:
    net, x, σ = CNNHOG(4), textured(1, 1, 8, 8), 3.0
    target = net.descriptor(textured(1, 1, 8, 8, seed=1)).permute(0, 3, 1, 2)
    scale = target.flatten(1).norm(dim=1)

    def distance(image: Tensor) -> Tensor:
        return (net._network(image) - target).flatten(1).norm(dim=1) / scale

    def objective(image: Tensor) -> Tensor:
        variation = image.diff(dim=2).square().sum() + image.diff(dim=3).square().sum()
        prior = cnn_hog.SMOOTHNESS / 2 * variation + cnn_hog.NORM_WEIGHT / 2 * (image**cnn_hog.NORM_POWER).sum()
        return σ**2 * distance(image).square().sum() + prior

    result, gradient = net._gradient(x, target, scale, σ)
    torch.testing.assert_close(result, distance(x))
    torch.testing.assert_close(gradient, torch.autograd.functional.jacobian(objective, x))


def test_total_variation_has_its_derivative() -> None:
    x = textured(2, 1, 6, 7).requires_grad_()
    (expected,) = torch.autograd.grad(x.diff(dim=2).square().sum() + x.diff(dim=3).square().sum(), x)
    torch.testing.assert_close(cnn_hog._total_variation_gradient(x.detach()), expected)


@pytest.fixture(scope="module")
def photographs() -> Tensor:
    from skimage import data

    from nablahog.io.images import limit_size

    return torch.stack(
        [limit_size(torch.from_numpy(data.camera()[a : a + 256, 100:356])[None] / 255, 32) for a in (0, 60)]
    )


@pytest.mark.slow
@pytest.mark.parametrize("bilinear", [False, True])
def test_inverts(photographs: Tensor, bilinear: bool) -> None:
    net = CNNHOG(8, bilinear=bilinear)
    descriptor = net.descriptor(photographs)
    result = net.reconstruct(descriptor, seed=1)
    assert result.image.shape == (2, 1, 32, 32)
    assert (float(result.image.min()), float(result.image.max())) == (0, 1)
    assert result.history.shape == (800, 2)
    assert result.evaluations.tolist() == [800, 800]
    for image, photograph in zip(result.image, photographs, strict=True):
        assert np.corrcoef(image.flatten(), photograph.flatten())[0, 1] > 0.5
    expected = (net.descriptor(result.image) - descriptor).flatten(1).norm(dim=1) / descriptor.flatten(1).norm(dim=1)
    torch.testing.assert_close(result.distance, expected)
    assert (result.distance < 0.5).all()


def test_a_batch_is_its_images_and_the_seed_decides(photographs: Tensor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cnn_hog, "RATE_ITERATIONS", 5)  # a long descent amplifies rounding, which depends on the batch
    net = CNNHOG(8, bilinear=True)
    descriptor = net.descriptor(photographs[..., :24, :24].double())
    began = time.perf_counter()
    both, one = net.reconstruct(descriptor), net.reconstruct(descriptor[1:])
    assert 0 < both.seconds + one.seconds < time.perf_counter() - began
    torch.testing.assert_close(both.image[1:], one.image, rtol=0, atol=1e-6)
    assert not torch.equal(one.image, net.reconstruct(descriptor[1:], seed=1).image)


def test_the_published_schedule_and_priors() -> None:
    """Of the paper's quantitative experiments, and of its code, `invert_nn.m`."""
    assert cnn_hog.LEARNING_RATES == (4e-3, 4e-4, 4e-5, 4e-6)
    assert (cnn_hog.RATE_ITERATIONS, cnn_hog.MOMENTUM) == (200, 0.9)
    assert (cnn_hog.NORM_POWER, cnn_hog.NORM_WEIGHT, cnn_hog.SMOOTHNESS) == (6, 8e-10, 1)
    assert pytest.approx(68.92, abs=0.01) == cnn_hog.NOISE  # a norm of 27098.1 over 227x227 pixels of three channels


def test_refusals() -> None:
    with pytest.raises(ValueError, match="whole cells of 8 pixels, at least two each way, got 16x20 pixels"):
        CNNHOG().descriptor(torch.zeros(1, 1, 16, 20))
    with pytest.raises(ValueError, match="the descriptor must not be zero"):
        CNNHOG().reconstruct(torch.zeros(1, 2, 2, 27))
