"""Derivatives at kinks, as ``docs/derivatives.md`` says: zero gradients, bin centres, hard votes, colours."""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import hog, presets
from nablahog.hog.gradient import gradient

from .differences import analytic, one_sided, vector, voter
from .zoo import DOUBLE, PRESETS, SPECS, noise, spec

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
    if {"zero": 0.0, "gray": 128 / 255}.get(SPECS[name].border, level) != level:
        pytest.skip("a constant image in a frame of another level has gradients")
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


@pytest.mark.slow
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
