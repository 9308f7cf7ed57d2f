"""Images as unknowns: the cosine transform by SciPy and by matrices, its basis, and exactly flat regions."""

from __future__ import annotations

import math

import pytest
import scipy.fft
import torch
from torch import Tensor

from nablahog import native
from nablahog.hog import hog, presets
from nablahog.invert.unknowns import CosineBasis, FlatRegions, cosines, from_cosines, low_pass, to_cosines

from .photographs import photograph

LIKE = torch.zeros(1, dtype=torch.float64)
CPU = torch.device("cpu")


def random_planes(height: int, width: int) -> Tensor:
    return torch.rand(2, 1, height, width, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize("n", [1, 2, 7, 12])
def test_the_matrix_is_the_orthonormal_dct(n: int) -> None:
    expected = scipy.fft.dct(torch.eye(n).double().numpy(), axis=0, norm="ortho")
    torch.testing.assert_close(cosines(n, torch.float64, CPU), torch.from_numpy(expected))


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (3, 5), (17, 12)])
def test_scipy_and_the_matrices_agree(size: tuple[int, int]) -> None:
    planes = random_planes(*size)
    rows, cols = (cosines(n, torch.float64, CPU) for n in size)
    torch.testing.assert_close(to_cosines(planes), rows @ planes @ cols.T)
    torch.testing.assert_close(from_cosines(planes), rows.T @ planes @ cols)
    assert to_cosines(planes.float()).dtype == torch.float32


def test_the_transform_is_differentiable_in_either_mode() -> None:
    planes = random_planes(5, 4).requires_grad_()
    for transform in (to_cosines, from_cosines):
        assert torch.autograd.gradcheck(transform, planes, check_forward_ad=True)
        with torch.no_grad():
            torch.testing.assert_close(transform(planes), transform(planes.detach().requires_grad_()))


def test_unknowns_and_images_are_inverse_and_adjoint() -> None:
    basis, image = CosineBasis(12, 17, LIKE), random_planes(12, 17)
    torch.testing.assert_close(basis.image(basis.unknowns(image)), image)
    unknowns = torch.rand(2, 12 * 17, dtype=torch.float64)
    torch.testing.assert_close(
        (basis.image(unknowns) * image).flatten(1).sum(1), (unknowns * basis.adjoint(image)).sum(1)
    )


def test_the_basis_is_orthonormal_and_scaled_by_frequency() -> None:
    image = torch.rand(1, 1, 9, 14, dtype=torch.float64)
    torch.testing.assert_close(CosineBasis(9, 14, LIKE, exponent=0).unknowns(image).norm(), image.norm())
    unit = torch.zeros(1, 16 * 16, dtype=torch.float64)
    unit[0, 3 * 16] = 1  # frequency 3 along y
    torch.testing.assert_close(CosineBasis(16, 16, LIKE, 1.0).image(unit).norm().item(), 1 / 3)


def test_low_pass_is_a_gaussian_that_keeps_constants() -> None:
    torch.testing.assert_close(low_pass(torch.full((2, 1, 8, 5), 0.7), 2.0), torch.full((2, 1, 8, 5), 0.7))
    impulse = torch.zeros(1, 1, 41, 41, dtype=torch.float64)
    impulse[..., 20, 20] = 1
    distance = torch.arange(-20, 21, dtype=torch.float64)
    bell = torch.exp(-distance.square() / (2 * 2.0**2)) / (2.0 * math.sqrt(2 * math.pi))
    torch.testing.assert_close(low_pass(impulse, 2.0)[0, 0], torch.outer(bell, bell), atol=1e-6, rtol=0)


# --- flat regions: recovered from the descriptor, made constant by a projection, on any device

SPEC = presets.uoctti(8)


def test_flat_regions_are_found_made_constant_and_silent() -> None:
    image = photograph(64).clone()
    image[..., :, :40] = 1.0
    descriptor = hog(image, SPEC)
    flat, index, noise = FlatRegions(descriptor, SPEC, 64, 64), torch.zeros(1, dtype=torch.long), torch.rand_like(image)
    made, known = flat(noise, index), flat.regions[0] > 0
    assert known[1:-1, 1:34].all()  # the corners of the ring, which does not vote, remain unknown
    assert not known[:, 44:].any()
    assert made[0, 0][known].unique().numel() == 1
    torch.testing.assert_close(made[0, 0][known][0], noise[0, 0][known].mean())
    assert torch.equal(made[0, 0][~known], noise[0, 0][~known])
    empty = (descriptor == 0).all(-1)
    assert empty.any()
    assert (hog(made, SPEC)[empty] == 0).all()


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
def test_flat_regions_are_levelled_by_a_projection(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(native, "available", lambda: False)
    image = photograph(48).double()
    image[..., :20, :20], image[..., 30:, 30:] = 0.2, 0.9
    regions = FlatRegions(hog(image.repeat(2, 1, 1, 1), SPEC), SPEC, 48, 48)
    assert len(regions.sizes) > 3
    index, pixels = torch.tensor([1, 0]), torch.rand(2, 1, 48, 48, dtype=torch.float64, requires_grad=True)
    levelled = regions(pixels, index)
    expected = pixels.detach().clone()
    for label in range(1, len(regions.sizes)):
        of_it = (regions.regions[index] == label).unsqueeze(1)
        if of_it.any():
            expected[of_it] = expected[of_it].mean()
    torch.testing.assert_close(levelled, expected)
    with torch.no_grad():
        assert torch.equal(regions.level(pixels.clone(), index), levelled)
        torch.testing.assert_close(regions(levelled, index), levelled)
    direction = torch.rand_like(pixels)
    (result,) = torch.autograd.grad(levelled, pixels, direction)
    torch.testing.assert_close(result, regions(direction, index))  # its own adjoint
    tangent = torch.func.jvp(lambda x: regions(x, index), (pixels.detach(),), (direction,))[1]
    torch.testing.assert_close(tangent, regions(direction, index))


def test_a_textured_image_is_left_alone() -> None:
    noise = torch.rand(2, 1, 32, 32)
    assert torch.equal(FlatRegions(hog(noise, SPEC), SPEC, 32, 32)(noise, torch.arange(2)), noise)
