"""The cosine transform by SciPy, by matrices, and by Fourier transforms: one result."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import scipy.fft
import torch
from torch import Tensor

from nablahog.invert import cosine_transform
from nablahog.invert.cosine_transform import by_fourier, by_products, cosines, from_cosines, to_cosines

SIZES = [(1, 1), (1, 9), (2, 2), (3, 5), (16, 16), (17, 12), (101, 64)]
sizes = pytest.mark.parametrize("size", SIZES)
ways = pytest.mark.parametrize("way", [by_fourier, by_products])


def random_planes(size: tuple[int, int]) -> Tensor:
    return torch.rand(2, 1, *size, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize("n", [1, 2, 7, 12])
def test_the_matrix_is_that_of_the_orthonormal_dct(n: int) -> None:
    matrix = cosines(n, torch.float64, torch.device("cpu"))
    torch.testing.assert_close(
        matrix, torch.from_numpy(scipy.fft.dct(torch.eye(n).double().numpy(), axis=0, norm="ortho"))
    )


@sizes
def test_on_a_cpu_it_is_products_with_the_matrices(size: tuple[int, int]) -> None:
    planes = random_planes(size).requires_grad_()
    torch.testing.assert_close(to_cosines(planes), by_products(planes, False))
    torch.testing.assert_close(from_cosines(planes), by_products(planes, True))
    assert to_cosines(planes.float()).dtype == torch.float32
    with torch.no_grad():
        assert torch.equal(to_cosines(planes), to_cosines(planes.requires_grad_()))
    if size == (17, 12):
        for transform in (to_cosines, from_cosines):
            assert torch.autograd.gradcheck(transform, planes, check_forward_ad=True)


@ways
@sizes
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values_and_gradients_on_a_device_are_those_on_a_cpu(
    way: Callable[[Tensor, bool], Tensor], size: tuple[int, int], dtype: torch.dtype
) -> None:
    weights = torch.rand(2, 1, *size, generator=torch.Generator().manual_seed(1), dtype=dtype)
    rounding = 1e-5 if dtype == torch.float32 else 1e-12
    close = {"atol": rounding, "rtol": rounding}
    for inverse, transform in ((False, to_cosines), (True, from_cosines)):
        planes = random_planes(size).to(dtype).requires_grad_()
        one, other = transform(planes), way(planes, inverse)
        assert other.dtype == dtype
        torch.testing.assert_close(other, one, **close)
        (mine,), (theirs,) = (torch.autograd.grad(out, planes, weights) for out in (other, one))
        torch.testing.assert_close(mine, theirs, **close)


@ways
@pytest.mark.parametrize("size", [(5, 7), (4, 6), (3, 8)])
@pytest.mark.parametrize("inverse", [False, True])
def test_both_are_differentiable_in_either_mode(
    way: Callable[[Tensor, bool], Tensor], size: tuple[int, int], inverse: bool
) -> None:
    planes = random_planes(size).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: way(x, inverse), planes, check_forward_ad=True)


@sizes
def test_the_inverse_undoes_the_transform(size: tuple[int, int]) -> None:
    planes = random_planes(size)
    torch.testing.assert_close(by_fourier(by_fourier(planes, False), True), planes)


def test_large_images_on_a_device_take_the_fourier_transform(monkeypatch: pytest.MonkeyPatch) -> None:
    called = []
    for name in ("by_products", "by_fourier"):
        monkeypatch.setattr(cosine_transform, name, lambda planes, inverse, name=name: called.append(name) or planes)
    for height, width in ((512, 300), (512, 513), (600, 3)):
        to_cosines(torch.empty(1, 1, height, width, device="meta"))
    assert called == ["by_products", "by_fourier", "by_fourier"]
