"""Derivatives: equal to differences where the descriptor is smooth; of normalisers, roots and borders also at kinks."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad, gradcheck, gradgradcheck
from torch.testing import assert_close

from nablahog.hog import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm, hog, presets
from nablahog.hog.descriptor import histograms, histograms_jvp, normalize
from nablahog.hog.gradient import gradient
from nablahog.hog.normalizers import Normalizer
from nablahog.hog.normalizers.block import BlockForm
from nablahog.hog.normalizers.per_cell import GlobalForm
from nablahog.hog.steps import normalize_reference

from .differences import Function, analytic, assert_jacobian_equals_central_differences, one_sided, vector
from .zoo import DOUBLE, PRESETS, SPECS, fits, integers, noise, rounding, sized, spec, waves

# --- away from kinks -------------------------------------------------------------------------------------------------

OWN = [name for name, s in SPECS.items() if (s.angle, s.derivative) == ("exact", "own")]
SMALL = {name: sized(SPECS[name], 2) for name in PRESETS if name in OWN}


@pytest.mark.parametrize(
    ("name", "channels"), [(name, c) for name, c in itertools.product(OWN, (1, 2, 3)) if fits(SPECS[name], c, 9, 8)]
)
def test_jacobian_equals_central_differences(name: str, channels: int) -> None:
    assert_jacobian_equals_central_differences(noise(1, channels, 9, 8, seed=channels), SPECS[name])


@pytest.mark.parametrize("name", [name for name in SPECS if name not in OWN])
def test_derivatives_of_another_angle_or_bin(name: str) -> None:
    """Straight through hard votes it is exactly that of linear ones; of a library's angle, that of the exact one."""
    s, x = SPECS[name], noise(1, 3, 9, 8)
    linear = s.with_linear_votes()
    result = torch.func.jacrev(lambda z: histograms(z, s))(x)
    assert_close(torch.func.jacfwd(lambda z: histograms(z, s))(x), result, rtol=1e-12, atol=1e-12)
    exact = torch.func.jacrev(lambda z: histograms(z, linear))(x)
    # the angle's error is in the votes, and they are in the derivative with respect to the magnitude
    tolerance = 1e-12 if s.derivative == "linear" else 5e-3
    assert_close(result, exact, rtol=0, atol=tolerance * exact.abs().max().item())
    if s.vote == "hard":
        assert torch.equal(histograms(x, s), histograms(x, dataclasses.replace(s, derivative="own")))


@pytest.mark.parametrize("name", SMALL)
def test_gradcheck(name: str) -> None:
    """PyTorch's own check, which takes each column of the Jacobian in a call of its own."""
    s = SMALL[name]
    x = noise(1, 1, *s.image_size(1, 2), seed=2).requires_grad_()
    assert gradcheck(lambda z: hog(z, s), (x,), atol=1e-6, rtol=1e-6, check_forward_ad=True)


@pytest.mark.parametrize("name", SMALL)
def test_second_derivatives(name: str) -> None:
    s = SMALL[name]
    x = noise(1, 1, *s.image_size(2, 2), seed=3).requires_grad_()
    assert gradgradcheck(lambda z: hog(z, s), (x,), fast_mode=True, check_fwd_over_rev=True)


@pytest.mark.parametrize("name", SPECS)
def test_tangents_of_histograms_are_those_of_the_reference(name: str) -> None:
    s, x = SPECS[name], noise(2, 3, 14, 11)
    expected = torch.func.jvp(lambda z: histograms(z, s, backend="torch"), (x,), (waves(x),))[1]
    tolerance = rounding(s) * float(expected.abs().max())
    assert_close(histograms_jvp(x, waves(x), s), expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", ["uoctti", "opencv", "maskfeat"])
def test_several_cotangents_at_once(name: str) -> None:
    """As in ``torch.autograd.functional.jacobian(vectorize=True)``: of descriptors and of the normaliser."""
    s = SPECS[name]
    image = noise(1, 3, 9, 8).requires_grad_()
    cells = histograms(image.detach(), s).requires_grad_()
    for output, at in ((hog(image, s), image), (normalize(cells, s), cells)):
        cotangents = torch.stack([waves(output, last) for last in (3, 20)])
        each = torch.stack([torch.autograd.grad(output, at, one, retain_graph=True)[0] for one in cotangents])
        (together,) = torch.autograd.grad(output, at, cotangents, is_grads_batched=True)
        assert_close(together, each, rtol=0, atol=rounding(s) * float(each.abs().max()))


class Nothing(torch.autograd.Function):
    """Passes on no gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        return x.clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> None:
        return None


def test_no_gradient_gives_none() -> None:
    x = noise(1, 1, 16, 16).requires_grad_()
    with forward_ad.dual_level():
        passed: Tensor = Nothing.apply(hog(x, "paper"))  # type: ignore[no-untyped-call]
        assert torch.autograd.grad(passed.sum(), x, allow_unused=True) == (None,)


@pytest.mark.parametrize("form", ["printed", "robust"])
def test_bytes_gray_central_differences_agree_at_all_kinks(form: GlobalForm) -> None:
    """Unsigned linear votes have only kinks whose one-sided derivatives average to what the operator returns."""
    x = integers(1, 1, 12, 12, seed=5, levels=4)
    s = presets.paper(4, global_form=form)
    gx, gy = gradient(x, s)
    assert (gx == 0).any()  # bin centres
    assert ((gx == 0) & (gy == 0))[:, 1:-1, 1:-1].any()  # zero gradients, besides those of the corners
    assert_jacobian_equals_central_differences(x, s, tolerance=1e-5)


def test_bytes_uoctti_central_differences_agree_at_bin_centres() -> None:
    rows = torch.randint(0, 9, (1, 1, 12, 1), generator=torch.Generator().manual_seed(6)) // 4
    columns = 11 * torch.arange(12).view(1, 1, 1, 12) + torch.tensor([0, 3, 0, 1, 5, 0, 2, 1, 1, 0, 2, 0])
    x = (rows + columns).to(DOUBLE) / 255
    s = presets.uoctti(4)
    gx, gy = gradient(255 * x, s)
    assert (gy[:, 1:-1] == 0).any()
    assert (gx[:, :, 1:-1] > 0).all()
    assert_jacobian_equals_central_differences(x, s, tolerance=1e-5)


# --- normalisers -----------------------------------------------------------------------------------------------------


def normalizing(scheme: Normalizer, bins: int) -> Function:
    """The descriptor of one cell as a function of its first votes; the other bins are empty."""
    s = spec(bins=bins, signed=True, normalizer=scheme)
    return lambda v: normalize_reference(torch.cat([v, v.new_zeros(bins - len(v))]).view(1, bins, 1, 1), s).flatten()


# votes that reach a limit together: the clip after a division by √(4 · 0.7² + 1), or by √(1 + 1 + 1); the length ε
CLIP = float(vector(0.7) * torch.rsqrt(4 * vector(0.7) ** 2 + 1))
LIMITS: dict[str, tuple[Normalizer, Tensor]] = {
    "clip": (FourBlockNorm(epsilon=1.0, clip=CLIP), vector(0.7)),
    "clip of blocks": (BlockNorm((1, 1), epsilon=1.0, epsilon_again=1.0, clip=float(vector(3).rsqrt())), vector(1, 1)),
    "floor": (CellNorm(0.5), vector(0.5)),
    "floor of four blocks": (FourBlockNorm(epsilon=1.0, clip=9.0, floor=True), vector(0.5)),
}


@pytest.mark.parametrize("name", LIMITS)
def test_limits_have_the_mean_derivative(name: str) -> None:
    scheme, at = LIMITS[name]
    f, direction = normalizing(scheme, 6), torch.ones_like(at)
    if isinstance(scheme, FourBlockNorm | BlockNorm) and name.startswith("clip"):
        wide, narrow = (dataclasses.replace(scheme, clip=scheme.clip * factor) for factor in (1 + 1e-15, 1 - 1e-15))
        assert (analytic(normalizing(narrow, 6), at, direction) == 0).all()
        _, behind = one_sided(normalizing(wide, 6), at, direction)  # one rounding to a side, it is that of the side
        assert_close(analytic(normalizing(wide, 6), at, direction), behind, rtol=1e-6, atol=1e-9)
    ahead, behind = one_sided(f, at, direction)
    assert_close(ahead, 0 * ahead, rtol=0, atol=1e-9)
    assert behind[0] > 0.01
    assert_close(analytic(f, at, direction), behind / 2, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("scheme", "slope"),
    [
        (GlobalNorm(0.01), 10.0),  # 1/√ε as printed, 1/ε for the robust form
        (GlobalNorm(0.01, "robust"), 100.0),
        (CellNorm(0.01), 100.0),
        (BlockNorm((1, 1), form="L1", epsilon=0.01), 100.0),
        (BlockNorm((1, 1), form="L1-sqrt", epsilon=0.01), 0.0),  # infinite, and taken to be 0
        (BlockNorm((1, 1), form="L2", epsilon=0.01), 100.0),
        (BlockNorm((1, 1), form="L2", epsilon=0.01, epsilon_outside_root=True), 100.0),
        (BlockNorm((1, 1), epsilon=0.01, epsilon_again=0.1), 1000.0),
        (BlockNorm((1, 1), epsilon=0.01, epsilon_again=0.1, epsilon_outside_root=True), 1000.0),
        (FourBlockNorm(epsilon=0.01, clip=1, parts=("directed",)), 4 * 10.0 / 2),
        (FourBlockNorm(epsilon=0.01, clip=1, parts=("directed",), floor=True), 4 * 100.0 / 2),
    ],
    ids=str,
)
def test_slopes_at_zero(scheme: Normalizer, slope: float) -> None:
    """By both modes."""
    f, zero = normalizing(scheme, 6), torch.zeros(6, dtype=DOUBLE)
    for jacobian in (torch.func.jacrev(f)(zero), torch.func.jacfwd(f)(zero)):
        assert_close(jacobian, slope * torch.eye(6, dtype=DOUBLE))
    if isinstance(scheme, GlobalNorm):
        assert (torch.func.hessian(lambda v: f(v).sum())(zero) == 0).all()


@pytest.mark.parametrize("form", ["L1", "L1-sqrt", "L2", "L2-Hys"])
@pytest.mark.parametrize("added", [False, True])
def test_block_norms_beside_empty_entries(form: BlockForm, added: bool) -> None:
    """As hard votes leave most bins: derivatives of the others are right, those of the root of nothing are 0."""
    scheme = BlockNorm((1, 1), form=form, epsilon=0.1, epsilon_again=0.2, epsilon_outside_root=added, clip=0.4)
    f, at = normalizing(scheme, 5), vector(0.0, 0.7, 0.0, 0.2, 1.1)
    for direction in (vector(0, 1, 0, 0, 0), vector(0, 0.3, 0, -1, 0.5)):
        ahead, behind = one_sided(f, at, direction)
        assert_close(ahead, behind, rtol=1e-5, atol=1e-7)
        assert_close(analytic(f, at, direction), ahead, rtol=1e-5, atol=1e-7)
    to_empty = analytic(f, at, vector(1, 0, 0, 0, 0))
    assert to_empty.isfinite().all()
    assert (to_empty[0] == 0) == (form == "L1-sqrt")


# --- roots of gray values --------------------------------------------------------------------------------------------


def test_root_at_black_has_derivative_zero() -> None:
    """It would be infinite.  Of bright pixels it is right, even where they border on black ones."""
    x = noise(1, 1, 8, 8) + 0.1
    x[..., 2:5, 3:6] = 0.0
    s = spec(gamma="sqrt", normalizer=CellNorm(0.1))
    jacobian = torch.func.jacrev(lambda z: hog(z, s))(x)
    assert jacobian.isfinite().all()
    assert (jacobian[..., 2:5, 3:6] == 0).all()
    for y, col in ((2, 2), (5, 4), (0, 0)):
        direction = torch.zeros_like(x)
        direction[0, 0, y, col] = 1
        difference = (hog(x + 1e-6 * direction, s) - hog(x - 1e-6 * direction, s)) / 2e-6
        assert_close(jacobian[..., 0, 0, y, col], difference, rtol=0, atol=1e-6)


def test_root_of_negative_values_is_that_of_black() -> None:
    """A search may step below black."""
    s = spec(gamma="sqrt")
    x = noise(1, 1, 8, 8) - 0.3
    assert (x < 0).any()
    assert torch.equal(hog(x, s), hog(x.clamp(min=0), s))
    grad = torch.func.grad(lambda z: hog(z, s).square().sum())(x)
    assert (grad[x <= 0] == 0).all()
    assert grad.isfinite().all()


# --- separate colours ------------------------------------------------------------------------------------------------


def test_a_gray_image_has_the_derivatives_of_its_three_colours_together() -> None:
    s = SPECS["maskfeat"]
    gray = noise(1, 1, 12, 12)
    weights = noise(1, *s.grid(12, 12), s.channels, seed=1)
    grad = torch.func.grad(lambda z: (weights * hog(z, s)).sum())
    assert_close(grad(gray), grad(gray.expand(1, 3, 12, 12)).sum(dim=1, keepdim=True), rtol=1e-12, atol=1e-12)


# --- border ----------------------------------------------------------------------------------------------------------


def test_reflect_border_has_no_derivative_across() -> None:
    x = noise(1, 1, 6, 7)
    gx, gy = gradient(x, presets.paper())
    assert (gx[:, :, [0, -1]] == 0).all()
    assert (gy[:, [0, -1]] == 0).all()
    assert (gx[:, [0, -1], 1:-1] != 0).all()  # along the border it is as inside
    jacobian = torch.func.jacrev(lambda z: gradient(z, presets.paper())[0][0, :, 0])(x)
    assert (jacobian == 0).all()


def test_ignored_ring_still_has_derivatives() -> None:
    """Ring pixels cast no votes but are the neighbours of pixels that do; only the four corners are nobody's."""
    weights = noise(1, 2, 2, 31, seed=1)
    grad = torch.func.grad(lambda z: (weights * hog(z, presets.uoctti(4))).sum())(noise(1, 1, 8, 8))[0, 0]
    corners = torch.zeros(8, 8, dtype=torch.bool)
    corners[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    assert ((grad == 0) == corners).all()
