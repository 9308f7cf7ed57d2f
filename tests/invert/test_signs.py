"""Region signs: their directions, their energy, and the images of known scenes; and the polarity of an image."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn.functional import avg_pool2d
from torch.testing import assert_close

from nablahog import HOGSpec, presets
from nablahog.hog.descriptor import histograms
from nablahog.invert.polarity import CUE_WEIGHTS, brightness_cues
from nablahog.invert.reconstruction import find_negatives, negate
from nablahog.invert.starts import (
    BACKGROUND,
    COUPLING,
    FAINT_SHARE,
    ROUNDINGS,
    TRUST,
    _round,
    dominant_gradient,
    expected_cells,
    signed_cells,
)

from .photographs import correlation, photograph


def ramp(angle: float, size: int) -> Tensor:
    """(1, 1, size, size), rising by 0.01 a pixel towards ``angle``."""
    y, x = torch.meshgrid(*(torch.arange(size, dtype=torch.float64),) * 2, indexing="ij")
    return (0.5 + 0.01 * (math.cos(angle) * x + math.sin(angle) * y))[None, None]


def scene(name: str, height: int, width: int | None = None) -> Tensor:
    """(1, 1, height, width): regions whose signs all edges tie together."""
    y, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64) / n for n in (height, width or height)), indexing="ij")
    image = {
        "disc": (x - 0.5).square() + (y - 0.5).square() < 0.09,
        "bump": torch.exp(-((x - 0.5).square() + (y - 0.4).square()) / 0.05),
        "waves": torch.sin(7 * x) * torch.cos(5 * y),
    }[name]
    return image.double()[None, None]


def random_votes(seed: int, rows: int, cols: int, batch: int = 1) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(batch, 9, rows, cols, generator=generator, dtype=torch.float64)


def least_squares(votes: Tensor, spec: HOGSpec, trust: float, background: float) -> tuple[Tensor, Tensor]:
    """The module's problem solved for every sign pattern: all energies, and the image (rows, cols) of the least."""
    rows, cols = votes.shape[2:]
    length, angle = (field[0].flatten() for field in dominant_gradient(votes, spec))
    unit = length.square().mean().sqrt()
    equations, pulls = [], []  # u times an equation is to be the sign times a pull
    for y, x in itertools.product(range(rows), range(cols)):
        dx, dy = torch.zeros(2, rows, cols, dtype=torch.float64)
        if 0 < x < cols - 1:
            dx[y, x + 1], dx[y, x - 1] = 1, -1
        if 0 < y < rows - 1:
            dy[y + 1, x], dy[y - 1, x] = 1, -1
        cell = y * cols + x
        across = torch.cos(angle[cell]) * dx + torch.sin(angle[cell]) * dy
        along = torch.cos(angle[cell]) * dy - torch.sin(angle[cell]) * dx
        pull = torch.zeros(rows * cols, dtype=torch.float64)
        pull[cell] = length[cell] / unit
        equations += [math.sqrt(trust) * across, along]
        pulls += [math.sqrt(trust) * pull, torch.zeros_like(pull)]
        for neighbour_y, neighbour_x in ((y, x + 1), (y + 1, x)):
            if neighbour_y < rows and neighbour_x < cols:
                difference = torch.zeros(rows, cols, dtype=torch.float64)
                difference[y, x], difference[neighbour_y, neighbour_x] = 1, -1
                equations.append(math.sqrt(COUPLING) * difference)
                pulls.append(torch.zeros_like(pull))
    total = votes[0].sum(dim=0)
    faint = torch.exp(-total / (FAINT_SHARE * total.mean()))
    faint[1:-1, 1:-1] = 0
    for cell, weight in enumerate(faint.flatten().tolist()):
        away = -(faint / faint.sum())
        away[cell // cols, cell % cols] += 1
        equations.append(math.sqrt(background * weight) * away)
        pulls.append(torch.zeros(rows * cols, dtype=torch.float64))
    matrix, targets = torch.stack(equations).flatten(1), torch.stack(pulls)
    patterns = torch.tensor(list(itertools.product([-1.0, 1.0], repeat=rows * cols)), dtype=torch.float64)
    images = torch.linalg.pinv(matrix) @ targets @ patterns.T  # the shortest: of zero mean
    energies = (matrix @ images - targets @ patterns.T).square().sum(0)
    return energies, images[:, energies.argmin()].view(rows, cols) * unit


@given(angle=st.floats(0, 2 * math.pi))
@pytest.mark.parametrize("spec", [presets.paper(8), presets.paper(8, bin_offset=0.0), presets.uoctti(8)], ids=repr)
def test_the_dominant_gradient_of_a_ramp_is_its_own(spec: HOGSpec, angle: float) -> None:
    votes = histograms(ramp(angle, 24), spec)
    length, result = dominant_gradient(votes, spec)
    error = (result[0, 1, 1].item() - angle + math.pi / 2) % math.pi - math.pi / 2
    assert abs(error) < math.radians(0.2)  # Eq. 3 shares a vote along the chord between two bins, not the arc
    total = votes[0, :, 1, 1].sum().item()
    assert 0.9 * total < length[0, 1, 1].item() <= total * (1 + 1e-9)


@pytest.mark.parametrize(
    ("name", "cell", "side", "least"),
    [
        *((name, (cell, cell), 12 * cell, 0.95) for name in ("disc", "bump", "waves") for cell in (1, 8)),
        *(("disc", cell, 96, 0.97) for cell in ((8, 2), (4, 16))),
    ],
)
def test_known_regions_come_back_up_to_one_sign(name: str, cell: tuple[int, int], side: int, least: float) -> None:
    spec, image = presets.paper(cell), scene(name, side)
    result = signed_cells(histograms(image, spec), spec, seed=0).images[:, :1]
    assert abs(correlation(result, avg_pool2d(image, cell))) > least


@pytest.mark.parametrize("cell", [1, 8])
@pytest.mark.parametrize("size", [(3, 3), (1, 6)])
def test_tiny_grids_reach_the_least_energy_of_all_patterns(size: tuple[int, int], cell: int) -> None:
    spec = presets.paper(cell)
    for seed in range(3):
        votes = random_votes(seed, *size)
        energies, image = least_squares(votes, spec, *((1.0, 0.0) if cell == 1 else (TRUST, BACKGROUND)))
        result = signed_cells(votes, spec, seed)
        assert result.energy[0, 0].item() == pytest.approx(energies.min().item(), abs=1e-8)
        for energy in result.energy[0]:
            assert (energies - energy).abs().min() < 1e-8  # each is some pattern's
        assert min((sign * result.images[0, 0] - image).abs().max() for sign in (1, -1)) < 1e-2 * image.abs().max()


def test_no_change_of_one_sign_lowers_the_energy() -> None:
    generator = torch.Generator().manual_seed(0)
    energy = torch.randn(2, 30, 30, generator=generator, dtype=torch.float64)
    energy = energy + energy.mT
    signs, energies = _round(energy, torch.randn(2, 30, 3, generator=generator, dtype=torch.float64), 0)
    assert_close(energies, ((signs @ energy) * signs).sum(dim=2))
    for k in range(30):
        changed = signs.clone()
        changed[:, :, k] *= -1
        assert (((changed @ energy) * changed).sum(dim=2) > energies - 1e-6).all()


def test_what_is_expected_is_the_mean_of_patterns_but_of_single_pixels_the_best() -> None:
    votes = random_votes(0, 7, 6, batch=2)
    for cell, patterns in ((8, slice(None)), (1, slice(1))):
        result = signed_cells(votes, presets.paper(cell), seed=4)
        mean = result.images[:, patterns].mean(dim=1)
        torch.testing.assert_close(expected_cells(votes, presets.paper(cell), seed=4), mean)


def test_the_flat_border_is_one_background() -> None:
    """A bar has an edge up and an edge down; two steps up would have the same votes."""
    spec, image = presets.paper(8), torch.full((1, 1, 64, 64), 0.3, dtype=torch.float64)
    image[..., 20:44] = 0.7
    cells = expected_cells(histograms(image, spec), spec, seed=0)[0]
    left, bar, right = cells[:, 0].mean(), cells[:, 3:5].mean(), cells[:, -1].mean()
    assert (left - right).abs() < 0.1 * (bar - left).abs()


def test_batch_equals_loop_in_both_precisions() -> None:
    spec = presets.paper(8)
    votes = torch.cat([histograms(scene(name, 64), spec) for name in ("disc", "bump", "waves")])
    together = signed_cells(votes, spec, seed=0)
    for i in range(3):
        alone = signed_cells(votes[i : i + 1], spec, seed=0)
        torch.testing.assert_close(together.images[i, :2], alone.images[0, :2])  # further ones may be equally good
        torch.testing.assert_close(together.energy[i], alone.energy[0])
    single = signed_cells(votes.float(), spec, seed=0)
    assert single.images.dtype == single.energy.dtype == torch.float32
    torch.testing.assert_close(single.images[:, :2].double(), together.images[:, :2], atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("size", [(4, 5), (1, 1)])
@pytest.mark.parametrize("cell", [1, 8])
def test_no_votes_make_no_image(size: tuple[int, int], cell: int) -> None:
    result = signed_cells(torch.zeros(2, 9, *size), presets.paper(cell), seed=0)
    assert result.images.shape == (2, ROUNDINGS, *size)
    assert (result.images == 0).all()
    assert (result.energy == 0).all()


@pytest.mark.parametrize("size", [(15, 13), (16, 16)])
def test_a_large_grid_is_solved_at_half_its_resolution(size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    spec = presets.paper(8)
    image = scene("bump", 8 * size[0], 8 * size[1])
    votes = histograms(image, spec)
    full = signed_cells(votes, spec, seed=0)
    monkeypatch.setattr("nablahog.invert.starts.MAX_CELLS", 64)
    halved = signed_cells(votes, spec, seed=0)
    assert halved.images.shape == full.images.shape == (1, ROUNDINGS, *size)
    assert halved.energy.shape == (1, ROUNDINGS)
    assert not torch.equal(halved.images, full.images)
    assert abs(correlation(halved.images[0, 0], avg_pool2d(image, 8))) > 0.93
    assert 0.7 < (halved.images[0, 0].std() / full.images[0, 0].std()).item() < 1.3


@pytest.mark.parametrize("motion", ["turn", "mirror"])
def test_a_turned_image_has_turned_signs(motion: str) -> None:
    def move(image: Tensor) -> Tensor:
        return image.rot90(1, (-2, -1)) if motion == "turn" else image.flip(-1)

    spec, image = presets.paper(8, bins=8), scene("waves", 64)  # whose bins a quarter turn maps to each other
    still, moved = (signed_cells(histograms(x, spec), spec, seed=0) for x in (image, move(image)))
    torch.testing.assert_close(still.energy[:, 0], moved.energy[:, 0])  # the others may end elsewhere
    expected, result = move(still.images[:, :1]), moved.images[:, :1]
    sign = torch.sign((expected * result).sum())
    torch.testing.assert_close(result, sign * expected)


# --- polarity


def sky(noise_of_sky: float = 0.0) -> Tensor:
    """(1, 1, 64, 64): white above, dark texture below."""
    noise = torch.rand(2, 1, 32, 64, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return torch.cat([0.97 - noise_of_sky * noise[:1], 0.1 + 0.3 * noise[1:]], dim=2)


@given(height=st.integers(1, 20), width=st.integers(1, 20), seed=st.integers(0, 1000))
def test_every_cue_changes_its_sign_with_the_image(height: int, width: int, seed: int) -> None:
    image = torch.rand(2, 1, height, width, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    cues = brightness_cues(image)
    assert cues.shape == (2, 4)
    assert torch.isfinite(cues).all()
    assert cues[:, :3].abs().max() <= 1 + 1e-9  # correlations
    torch.testing.assert_close(brightness_cues(1 - image), -cues, atol=1e-6, rtol=1e-6)


def test_the_weighted_cues_decide_for_each_image_of_a_batch() -> None:
    images = torch.cat([photograph(64, name) for name in ("camera", "coins", "coffee", "astronaut", "page", "moon")])
    images = torch.cat([images, 1 - images])
    which, confidence = find_negatives(images)
    assert confidence is None
    assert torch.equal(which, (brightness_cues(images) * torch.tensor(CUE_WEIGHTS)).sum(dim=1) < 0)
    assert torch.equal(which[:6], ~which[6:])
    made = negate(images, which)
    torch.testing.assert_close(made[:6], made[6:])
    assert all(torch.equal(a, 1 - b if turned else b) for a, b, turned in zip(made, images, which, strict=True))


def test_the_confidence_of_a_prior_decides_alone() -> None:
    which, confidence = find_negatives(torch.cat([sky(), sky()]), torch.tensor([0.2, 0.7]))
    assert which.tolist() == [True, False]
    torch.testing.assert_close(confidence, torch.tensor([0.8, 0.7]))


def test_a_constant_image_has_no_cue() -> None:
    for gray in (0.1, 0.5, 0.9):
        assert (brightness_cues(torch.full((1, 1, 16, 16), gray)) == 0).all()


def test_what_is_flat_is_bright_exactly_or_nearly() -> None:
    for image, exactly in ((sky(), True), (sky(0.008), False)):
        exactly_flat, flat, _, _ = brightness_cues(image)[0]
        assert (exactly_flat > 0.7) if exactly else (exactly_flat == 0)
        assert flat > 0.7
        assert find_negatives(torch.cat([image, 1 - image]))[0].tolist() == [False, True]


def test_contrast_is_stronger_in_the_light_and_highlights_are_small_and_bright() -> None:
    light = torch.linspace(0.1, 1, 64, dtype=torch.float64).reshape(1, 1, 1, 64)
    reflectance = torch.rand(1, 1, 64, 64, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert brightness_cues(light * (0.3 + 0.7 * reflectance))[0, 2] > 0.7
    image = torch.full((1, 1, 32, 32), 0.2, dtype=torch.float64)
    image[..., 4::8, 4::8] = 1
    assert brightness_cues(image)[0, 3] > 1


@pytest.mark.parametrize("bin_", [0, 4, 8])
def test_votes_of_one_bin_point_to_its_centre(bin_: int) -> None:
    votes = torch.zeros(1, 9, 2, 3, dtype=torch.float64)
    votes[:, bin_] = 3.0
    length, angle = dominant_gradient(votes, presets.paper(8))
    torch.testing.assert_close(length, torch.full((1, 2, 3), 3.0, dtype=torch.float64))
    turn = (angle - math.radians(20 * bin_ + 10)) / math.pi
    torch.testing.assert_close(turn, turn.round())


def test_energy_does_not_depend_on_the_votes_unit_and_the_image_does() -> None:
    votes = random_votes(1, 5, 6)
    one, many = (signed_cells(unit * votes, presets.paper(8), seed=0) for unit in (1.0, 1e4))
    torch.testing.assert_close(one.energy, many.energy)
    torch.testing.assert_close(1e4 * one.images[:, 0], many.images[:, 0])
