"""Values and derivatives are finite for any finite image, and NaN for any other."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.descriptor import Backend, histograms

from .differences import vector, voter
from .zoo import DOUBLE, SPECS, fits, integers, noise, sized


def one_pixel(level: float, by: float) -> Tensor:
    x = torch.full((1, 3, 8, 8), level, dtype=DOUBLE)
    x[0, 1, 3, 4] += by
    return x


FEW_IMAGES = torch.cat([torch.zeros(1, 3, 8, 8, dtype=DOUBLE), one_pixel(0.5, 2e-7), integers(1, 3, 8, 8, levels=6)])
MORE_IMAGES = torch.cat(
    [
        torch.ones(1, 3, 8, 8, dtype=DOUBLE),
        torch.full((1, 3, 8, 8), 0.3, dtype=DOUBLE),
        one_pixel(0.5, 1 / 255),
        integers(1, 3, 8, 8, levels=2),
        torch.arange(8, dtype=DOUBLE).remainder(2).expand(1, 3, 8, 8),
        # gradients so small that their square underflows, or one over their square overflows
        *(
            size * image
            for size in (1e-8, 1e-15, 1e-20, 1e-30, 1e-40, 1e-70, 1e-155, 1e-280)
            for image in (noise(1, 3, 8, 8), one_pixel(0, 1))
        ),
    ]
)
ONE_PIXEL = noise(1, 3, 1, 1)  # its descriptor is constant, which must not make backward() raise
SMALL_IMAGES = [noise(1, 1, 2, 2), noise(1, 3, 1, 9), integers(1, 1, 9, 1, levels=3)]


def assert_finite_in_every_mode(x: Tensor, s: HOGSpec) -> None:
    x = x.clone().requires_grad_()
    descriptor = hog(x, s)
    assert descriptor.isfinite().all(), "value"
    weights = noise(*descriptor.shape, seed=7, dtype=x.dtype)
    (grad,) = torch.autograd.grad((weights * descriptor).sum(), x, create_graph=True)
    assert grad.isfinite().all(), "reverse mode"
    tangent = noise(*x.shape, seed=8, dtype=x.dtype)
    (second,) = torch.autograd.grad((tangent * grad).sum(), x)
    assert second.isfinite().all(), "second derivative, reverse over reverse"
    x = x.detach()
    assert torch.func.jvp(lambda z: hog(z, s), (x,), (tangent,))[1].isfinite().all(), "forward mode"
    gradient_of = torch.func.grad(lambda z: (weights * hog(z, s)).sum())
    assert torch.func.jvp(gradient_of, (x,), (tangent,))[1].isfinite().all(), "second derivative, forward over reverse"


# one of each kind of gradients, votes and normalisers
KINDS = [
    *("paper", "paper-robust", "uoctti", "uoctti-hard", "cnn-hogb"),
    *("skimage-2x2", "skimage-root", "opencv", "maskfeat"),
    *("zero-largest", "sobel-separate", "derivative", "blocks-L2-added", "missing-floor"),
]


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in KINDS)) for name in SPECS])
def test_never_nan(name: str) -> None:
    """In any dialect for some images; in one of each kind for all of them, in both precisions."""
    of_kind = name in KINDS
    all_images = [torch.cat([FEW_IMAGES, MORE_IMAGES]), ONE_PIXEL, *SMALL_IMAGES]
    for images in all_images if of_kind else [FEW_IMAGES, ONE_PIXEL]:
        s = SPECS[name] if min(images.shape[-2:]) > 4 else sized(SPECS[name], (1, 1))
        if fits(s, *images.shape):
            for dtype in (torch.float32, torch.float64) if of_kind else (torch.float32,):
                assert_finite_in_every_mode(images.to(dtype), s)


@pytest.mark.parametrize(
    ("dtype", "kept", "dropped"),
    [(torch.float32, (1e-3, 1e-6, 1e-9), (1e-10, 1e-20)), (torch.float64, (1e-3, 1e-30, 1e-76), (1e-78, 1e-200))],
)
def test_tiny_gradients_have_the_derivatives_of_large_ones(
    dtype: torch.dtype, kept: tuple[float, ...], dropped: tuple[float, ...]
) -> None:
    """Votes are homogeneous: their Jacobian depends on the direction of the gradient only, until it counts as zero."""
    f = voter(presets.paper())
    at = vector(0.3, -0.7, dtype=dtype)
    large = torch.func.jacrev(f)(at)
    for size in kept:
        assert_close(torch.func.jacrev(f)(size * at), large, rtol=1e-5, atol=1e-5)
    for size in dropped:
        assert (torch.func.jacrev(f)(size * at) == 0).all()


@pytest.mark.parametrize(
    ("name", "backend"), [*((name, "auto") for name in SPECS), *((name, "torch") for name in KINDS)]
)
def test_pixel_that_is_not_finite_makes_its_image_nan(name: str, backend: Backend) -> None:
    """All of the descriptor, of the gradient and of the tangent, whatever the channel; no other image's."""
    s = SPECS[name]
    side = next(n for n in range(19, 80) if fits(s, 3, n, n))  # its last pixels are in no cell of 8
    clean = noise(4, 3, side, side)
    x = clean.clone()
    x[0, 0, 2, 2], x[1, 1, 0, 0], x[2, 2, -1, 5] = math.nan, math.inf, -math.inf
    weights, tangent = noise(*hog(x, s).shape, seed=7), noise(*x.shape, seed=8)

    def operator(images: Tensor) -> Tensor:
        return hog(images, s, backend=backend)

    def gradient_of(images: Tensor) -> Tensor:
        return torch.func.grad(lambda z: (weights * operator(z)).sum())(images)

    of_x, of_clean = (
        (
            operator(images),
            histograms(images, s, backend=backend),
            gradient_of(images),
            torch.func.jvp(operator, (images,), (tangent,))[1],
            torch.func.jvp(gradient_of, (images,), (tangent,))[1],
        )
        for images in (x, clean)
    )
    for spoilt, intact in zip(of_x, of_clean, strict=True):
        assert spoilt[:3].isnan().all()
        assert_close(spoilt[3], intact[3], rtol=0, atol=0)
