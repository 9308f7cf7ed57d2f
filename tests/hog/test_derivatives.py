"""Derivatives: equal to differences where the descriptor is smooth, as ``docs/derivatives.md`` says at every kink."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck, gradgradcheck
from torch.testing import assert_close

from nablahog.hog import FourBlockNorm, GlobalNorm, HOGSpec, hog, presets
from nablahog.hog.gradient import gradient
from nablahog.hog.normalize import four_block_norm, global_norm
from nablahog.hog.orientation import votes
from nablahog.hog.spec import GlobalForm

from .zoo import DOUBLE, PRESETS, SPECS, integers, noise, spec

Function = Callable[[Tensor], Tensor]


def one_sided(f: Function, x: Tensor, direction: Tensor, h: float = 1e-4) -> tuple[Tensor, Tensor]:
    """The derivatives of f at x along ``direction``, from ahead and from behind, by differences of second order."""
    ahead = (4 * f(x + h * direction) - f(x + 2 * h * direction) - 3 * f(x)) / (2 * h)
    behind = (3 * f(x) - 4 * f(x - h * direction) + f(x - 2 * h * direction)) / (2 * h)
    return ahead, behind


def analytic(f: Function, x: Tensor, direction: Tensor) -> Tensor:
    """The derivative of f at x along ``direction`` that the operator returns, by both modes, which must agree."""
    _, forward = torch.func.jvp(f, (x,), (direction,))
    jacobian = torch.func.jacrev(f)(x)
    reverse = (jacobian.flatten(-x.dim()) * direction.flatten()).sum(-1)
    assert_close(forward, reverse, rtol=1e-6, atol=1e-9)
    return forward


def voter(spec: HOGSpec) -> Function:
    """The votes of one pixel as a function of its gradient (gx, gy)."""
    return lambda g: votes(g[0].view(1, 1, 1), g[1].view(1, 1, 1), spec).flatten()


def vector(*values: float, dtype: torch.dtype = DOUBLE) -> Tensor:
    return torch.tensor(values, dtype=dtype)


# --- away from kinks -------------------------------------------------------------------------------------------------


def assert_jacobian_equals_central_differences(x: Tensor, s: HOGSpec, tolerance: float = 1e-6) -> None:
    """All of the Jacobian of one image, by both modes, against central differences; relative to its largest entry."""
    basis = torch.eye(x.numel(), dtype=x.dtype).view(-1, *x.shape[1:])
    h = 1e-6
    central = ((hog(x + h * basis, s) - hog(x - h * basis, s)) / (2 * h)).flatten(1).T
    reverse = torch.func.jacrev(lambda z: hog(z, s))(x).reshape(central.shape)
    forward = torch.func.jacfwd(lambda z: hog(z, s))(x).reshape(central.shape)
    size = central.abs().max().item()
    assert size > 0
    assert_close(reverse, central, rtol=0, atol=tolerance * size)
    assert_close(forward, reverse, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("channels", [1, 2, 3])
@pytest.mark.parametrize("name", SPECS)
def test_jacobian_equals_central_differences(name: str, channels: int) -> None:
    assert_jacobian_equals_central_differences(noise(1, channels, 9, 8, seed=channels), SPECS[name])


@pytest.mark.parametrize("name", PRESETS)
def test_gradcheck(name: str) -> None:
    """PyTorch's own check, which takes each column of the Jacobian in a call of its own."""
    x = noise(1, 2, 5, 4, seed=2).requires_grad_()
    assert gradcheck(lambda z: hog(z, PRESETS[name](3)), (x,), atol=1e-6, rtol=1e-6, check_forward_ad=True)


@pytest.mark.parametrize("name", PRESETS)
def test_second_derivatives(name: str) -> None:
    x = noise(1, 1, 4, 4, seed=3).requires_grad_()
    s = PRESETS[name](2)
    assert gradgradcheck(lambda z: hog(z, s), (x,), fast_mode=True, check_fwd_over_rev=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECS)
def test_second_derivatives_in_full(name: str) -> None:
    x = noise(1, 3, 8, 8, seed=4).requires_grad_()
    assert gradgradcheck(lambda z: hog(z, SPECS[name]), (x,), check_fwd_over_rev=True, check_rev_over_rev=True)


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


# --- zero gradient ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vote", ["linear", "hard"])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8), (-1.0, 0.0)])
def test_zero_gradient_has_derivative_zero(vote: str, signed: bool, direction: tuple[float, float]) -> None:
    """The tip of a cone.  The mean over all directions is 0; for unsigned bins also each pair of opposite ones."""
    f = voter(spec(vote=vote, signed=signed, bins=12 if signed else 9))
    ahead, behind = one_sided(f, vector(0, 0), vector(*direction))
    assert_close(ahead.sum(), vector(1.0)[0])  # the magnitude grows whichever way it goes
    assert_close(behind.sum(), vector(-1.0)[0])
    assert (analytic(f, vector(0, 0), vector(*direction)) == 0).all()
    if signed:
        assert (ahead + behind).abs().max() > 0.1  # opposite directions go to different bins: no pairwise balance
    else:
        assert_close(ahead, -behind)


@pytest.mark.parametrize("name", SPECS)
@pytest.mark.parametrize("level", [0.0, 0.3, 1.0])
def test_constant_image_has_derivative_zero(name: str, level: float) -> None:
    if SPECS[name].border == "zero" and level:
        pytest.skip("a constant image in a black frame has gradients")
    x = torch.full((1, 3, 8, 8), level, dtype=DOUBLE)
    assert (hog(x, SPECS[name]) == 0).all()
    assert (torch.func.jacrev(lambda z: hog(z, SPECS[name]))(x) == 0).all()
    assert (torch.func.jvp(lambda z: hog(z, SPECS[name]), (x,), (noise(1, 3, 8, 8),))[1] == 0).all()


def test_flat_image_of_many_channels_has_derivative_zero() -> None:
    """Equal pixels must have equal gray values to the last bit: the direction of a rounding error is a direction."""
    for channels, seed in itertools.product(range(2, 9), range(10)):
        flat = noise(1, channels, 1, 1, seed=seed, dtype=torch.float32).expand(1, channels, 9, 9)
        for memory_format in (torch.contiguous_format, torch.channels_last):
            x = flat.contiguous(memory_format=memory_format).requires_grad_()
            hog(x, presets.paper(4)).sum().backward()  # type: ignore[no-untyped-call]
            assert x.grad is not None
            assert (x.grad == 0).all()


# --- orientation of linear votes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("preset", "gx", "gy"),
    [("paper", 0, 2), ("paper", 0, -2), ("uoctti", 2, 0), ("uoctti", -2, 0), ("uoctti", -2, -0.0)],
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_bin_centre_has_mean_derivative(preset: str, gx: float, gy: float, dtype: torch.dtype) -> None:
    f = voter(PRESETS[preset]())
    at, across = vector(gx, gy), vector(-gy, gx) / 2
    ahead, behind = one_sided(f, at, across)
    assert (ahead - behind).abs().max() > 1  # there is a kink
    mean = (ahead + behind) / 2
    assert_close(analytic(f, at.to(dtype), across.to(dtype)), mean.to(dtype), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_bin_centre_has_mean_derivative_for_any_number_of_bins(dtype: torch.dtype) -> None:
    """Multiples of 90° that are bin centres: the vote of that bin has derivative 0 across."""
    missed = []
    for bins, signed, bin_offset, quarter in itertools.product(range(3, 41), (False, True), (0.0, 0.5), range(4)):
        position = quarter * bins / (4 if signed else 2) - bin_offset
        if position != int(position):
            continue
        gx, gy = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
        f = voter(spec(bins=bins, signed=signed, bin_offset=bin_offset))
        _, slope = torch.func.jvp(f, (vector(gx, gy, dtype=dtype),), (vector(-gy, gx, dtype=dtype),))
        if slope[int(position) % bins].abs() > 1e-3:
            missed.append((bins, signed, bin_offset, 90 * quarter))
    assert not missed


@pytest.mark.parametrize(
    ("preset", "gx", "gy"),
    [("paper", 2, 0), ("paper", -2, 0), ("paper", -2, -0.0), ("uoctti", 0, 2), ("uoctti", 0, -2)],
)
def test_halfway_between_bin_centres_is_no_kink(preset: str, gx: float, gy: float) -> None:
    """Among them 0° and 180° of the paper's bins, where the first bin follows the last."""
    f = voter(PRESETS[preset]())
    at, across = vector(gx, gy), vector(-gy, gx) / 2
    ahead, behind = one_sided(f, at, across)
    assert ahead.abs().max() > 1
    assert_close(ahead, behind, rtol=1e-6, atol=1e-6)
    assert_close(analytic(f, at, across), ahead, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("preset", ["paper", "uoctti"])
def test_no_jump_where_the_angle_wraps(preset: str) -> None:
    """Θ jumps from 180° to -180°; neither votes nor their derivatives see it."""
    f = voter(PRESETS[preset]())
    above, below = vector(-3, 0.0), vector(-3, -0.0)
    assert torch.atan2(above[1], above[0]) == -torch.atan2(below[1], below[0])
    assert_close(f(above), f(below), rtol=0, atol=1e-14)
    assert_close(torch.func.jacrev(f)(above), torch.func.jacrev(f)(below), rtol=0, atol=1e-14)
    assert_close(f(vector(-3, 1e-9)), f(vector(-3, -1e-9)), rtol=0, atol=1e-8)


# --- hard votes ------------------------------------------------------------------------------------------------------


def test_hard_tie_goes_to_first_bin_with_derivative_of_magnitude() -> None:
    """Vertical gradients lie between bins 4 and 5 of 9, 80° and 100°: 8-bit images are full of them."""
    f = voter(presets.uoctti(vote="hard"))
    up, down = vector(0, 3), vector(0, -3)
    assert f(up).nonzero().flatten().tolist() == [4]
    assert f(down).nonzero().flatten().tolist() == [13]
    assert f(vector(-1e-9, 3)).nonzero().flatten().tolist() == [5]  # the vote jumps
    along, across = vector(0, 1), vector(1, 0)
    assert_close(analytic(f, up, along), 1.0 * torch.eye(18, dtype=DOUBLE)[4])
    assert_close(analytic(f, down, along), -1.0 * torch.eye(18, dtype=DOUBLE)[13])
    assert (analytic(f, up, across) == 0).all()  # d‖∇‖/dgx at gx = 0; nothing of the jump


def test_hard_votes_do_not_see_the_orientation() -> None:
    f = voter(presets.uoctti(vote="hard"))
    for degrees in range(1, 360, 7):
        angle = torch.deg2rad(vector(degrees))[0]
        radial = torch.stack([angle.cos(), angle.sin()])
        assert_close(analytic(f, 2 * radial, radial), f(2 * radial) / 2)
        assert_close(analytic(f, 2 * radial, radial.flip(0) * vector(-1, 1)), 0 * f(radial))


# --- colour ----------------------------------------------------------------------------------------------------------


def test_colour_tie_follows_first_channel() -> None:
    """A gray picture stored as RGB: every pixel is a tie, and all of the derivative goes to the first channel."""
    s = presets.uoctti(4)
    plane = noise(1, 1, 8, 8)
    weights = noise(1, 2, 2, 31, seed=1)
    gray = torch.func.grad(lambda z: (weights * hog(z, s)).sum())(plane)
    colour = torch.func.grad(lambda z: (weights * hog(z, s)).sum())(plane.repeat(1, 3, 1, 1))
    assert_close(colour[:, :1], gray, rtol=1e-12, atol=0)
    assert gray.abs().max() > 0
    assert (colour[:, 1:] == 0).all()
    tangent = torch.stack([torch.zeros(8, 8), *noise(2, 8, 8, seed=2)]).to(DOUBLE).unsqueeze(0)
    assert (torch.func.jvp(lambda z: hog(z, s), (plane.repeat(1, 3, 1, 1),), (tangent,))[1] == 0).all()


def test_colour_tie_one_sided_derivatives() -> None:
    """The winner's magnitude is a maximum: ahead the raised channel wins, behind the other one stays."""

    def magnitude(second: Tensor) -> Tensor:
        x = torch.zeros(1, 2, 3, 3, dtype=DOUBLE)
        x[0, :, 1, 2] = 1.0
        raised = torch.zeros(2, dtype=DOUBLE).scatter(0, torch.tensor([1]), second)
        picture = x + torch.zeros_like(x).index_put(
            (torch.tensor([0, 0]), torch.tensor([0, 1]), torch.tensor([1, 1]), torch.tensor([2, 2])), raised
        )
        return gradient(picture, presets.uoctti(1))[0][0, 1, 1].view(1)

    ahead, behind = one_sided(magnitude, vector(0), vector(1))
    assert_close(ahead, vector(1.0))
    assert_close(behind, vector(0.0))
    assert (analytic(magnitude, vector(0), vector(1)) == 0).all()


def test_colour_winner_jumps() -> None:
    """Equal magnitudes in different directions: the descriptor itself jumps, so no derivative could be right."""
    x = torch.zeros(1, 2, 3, 3, dtype=DOUBLE)
    x[0, 0, 1, 2] = x[0, 1, 2, 1] = 1.0  # first channel: gradient to +x; second: to +y
    s = presets.uoctti(1)
    tied = [g[0, 1, 1].item() for g in gradient(x, s)]
    x[0, 1, 2, 1] += 1e-9
    raised = [g[0, 1, 1].item() for g in gradient(x, s)]
    assert tied == [1.0, 0.0]
    assert raised == [0.0, 1.0 + 1e-9]


# --- normalisers -----------------------------------------------------------------------------------------------------


def test_clip_has_mean_derivative() -> None:
    """One cell with one direction: its entries, directed and undirected, reach the clip together in all four blocks."""
    a = vector(0.7)
    entry = (a * torch.rsqrt(4 * a * a + 1)).item()

    def f(v: Tensor, clip: float = entry) -> Tensor:
        histogram = torch.cat([v, v.new_zeros(5)]).view(1, 6, 1, 1)
        return four_block_norm(histogram, FourBlockNorm(epsilon=1.0, clip=clip)).flatten()

    ahead, behind = one_sided(f, a, vector(1))
    assert_close(ahead, 0 * ahead, rtol=0, atol=1e-9)
    assert behind[0] > 0.1
    assert_close(analytic(f, a, vector(1)), behind / 2, rtol=1e-6, atol=1e-9)
    # one rounding to either side, it is one of the two
    assert_close(analytic(lambda v: f(v, entry * (1 + 1e-15)), a, vector(1)), behind, rtol=1e-6, atol=1e-9)
    assert (analytic(lambda v: f(v, entry * (1 - 1e-15)), a, vector(1)) == 0).all()


@pytest.mark.parametrize(
    ("scheme", "slope"), [(GlobalNorm(0.01), 10.0), (GlobalNorm(0.01, "robust"), 100.0)], ids=["printed", "robust"]
)
def test_global_norm_at_zero(scheme: GlobalNorm, slope: float) -> None:
    """Differentiable there: 1/√ε as printed, 1/ε for the robust form."""

    def f(v: Tensor) -> Tensor:
        return global_norm(v.view(1, 3, 2, 1), scheme).flatten()

    zero = torch.zeros(6, dtype=DOUBLE)
    assert_close(torch.func.jacrev(f)(zero), slope * torch.eye(6, dtype=DOUBLE))
    assert_close(torch.func.jacfwd(f)(zero), slope * torch.eye(6, dtype=DOUBLE))
    direction = vector(1, -2, 0, 3, 0.5, 1)
    for side in one_sided(f, zero, direction, h=1e-10):
        assert_close(side, slope * direction, rtol=1e-6, atol=0)
    assert (torch.func.hessian(lambda v: f(v).sum())(zero) == 0).all()


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


# --- never NaN -------------------------------------------------------------------------------------------------------


def one_pixel(level: float, by: float) -> Tensor:
    x = torch.full((1, 3, 8, 8), level, dtype=DOUBLE)
    x[0, 1, 3, 4] += by
    return x


IMAGES: dict[str, Tensor] = {
    "black": torch.zeros(1, 3, 8, 8, dtype=DOUBLE),
    "white": torch.ones(1, 3, 8, 8, dtype=DOUBLE),
    "flat": torch.full((1, 3, 8, 8), 0.3, dtype=DOUBLE),
    "one-pixel": one_pixel(0.5, 1 / 255),
    "one-pixel-barely": one_pixel(0.5, 2e-7),
    "binary": integers(1, 3, 8, 8, levels=2),
    "bytes": integers(1, 3, 8, 8, levels=6),
    "stripes": torch.arange(8, dtype=DOUBLE).remainder(2).expand(1, 3, 8, 8),
    "1x9": noise(1, 3, 1, 9),
    "9x1": integers(1, 1, 9, 1, levels=3),
    "2x2": noise(1, 1, 2, 2),
}
TINY: dict[str, Tensor] = {
    f"{kind}-{size:g}": size * image
    for size in (1e-8, 1e-10, 1e-15, 1e-18, 1e-20, 1e-22, 1e-30, 1e-40)
    for kind, image in {"noise": noise(1, 1, 8, 8), "one-pixel": one_pixel(0, 1)}.items()
}


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


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("image", IMAGES)
def test_never_nan(image: str, dtype: torch.dtype) -> None:
    x = IMAGES[image].to(dtype)
    for s in SPECS.values():
        smallest = dataclasses.replace(s, cell_size=(1, 1))
        assert_finite_in_every_mode(x, smallest if min(x.shape[-2:]) < 4 else s)


def test_one_pixel_has_derivative_zero() -> None:
    """Its descriptor is constant, which must not make backward() raise."""
    for s in SPECS.values():
        assert_finite_in_every_mode(noise(1, 3, 1, 1), dataclasses.replace(s, cell_size=(1, 1)))


@pytest.mark.parametrize("name", PRESETS)
def test_never_nan_for_tiny_gradients(name: str) -> None:
    """Gradients so small that their square underflows, or one over their square overflows."""
    for dtype in (torch.float32, torch.float64):
        for image in TINY.values():
            assert_finite_in_every_mode(image.to(dtype), PRESETS[name](4))
            assert_finite_in_every_mode((image**7).to(dtype), PRESETS[name](4))


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


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("name", PRESETS)
def test_nan_pixel_makes_nan_and_nothing_else(name: str, channels: int) -> None:
    """NaN where the pixel is seen; no exception, no effect on the other images of the batch."""
    s = PRESETS[name](4)
    clean = noise(2, channels, 16, 16)
    x = clean.clone()
    x[0, 0, 2, 2] = float("nan")
    descriptor = hog(x, s)
    assert descriptor[0, 0, 0].isnan().any()
    assert_close(descriptor[1], hog(clean, s)[1], rtol=0, atol=0)
    grad = torch.func.grad(lambda z: hog(z, s).square().sum())(x)
    assert grad[0].isnan().any()
    assert grad[1].isfinite().all()
    tangent = torch.func.jvp(lambda z: hog(z, s), (x,), (clean,))[1]
    assert tangent[0, 0, 0].isnan().any()
    assert tangent[1].isfinite().all()


@pytest.mark.parametrize("value", [float("inf"), float("-inf")])
@pytest.mark.parametrize("name", PRESETS)
def test_infinite_pixel_raises_nothing(name: str, value: float) -> None:
    x = noise(1, 3, 8, 8)
    x[0, 0, 4, 4] = value
    assert not hog(x, PRESETS[name](4)).isfinite().all()
    torch.func.grad(lambda z: hog(z, PRESETS[name](4)).sum())(x)
