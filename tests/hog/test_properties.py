"""What must hold for any image: symmetries, invariances, ranges."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.testing import assert_close

from nablahog.hog import BilinearCells, BlockNorm, BoxCells, FourBlockNorm, GlobalNorm, HOGSpec, hog, presets

from .zoo import PRESETS, SPECS, integers, noise, spec

seeds = st.integers(0, 2**31 - 1)
small = st.integers(1, 4)
a_few_times = settings(max_examples=4)  # for each dialect


# --- symmetries ------------------------------------------------------------------------------------------------------


def mirrored(bins: int, per_turn: int, turns: int, s: HOGSpec) -> list[int]:
    """Bin of a mirrored gradient for each bin: Θ becomes 90°·``turns`` - Θ, with so many bins in a full turn."""
    shift = (-1 if s.counterclockwise else 1) * turns * per_turn / 4 - 2 * s.bin_offset
    assert shift == int(shift)
    return [(int(shift) - k) % bins for k in range(bins)]


def flip_of_four_blocks(s: HOGSpec, scheme: FourBlockNorm, turns: int) -> list[int]:
    n = s.bins // 2 if s.signed else s.bins
    undirected = mirrored(n, 2 * n, turns, s)
    left_right, up_down = [1, 0, 3, 2], [2, 3, 0, 1]  # of blocks up-left, up-right, down-left, down-right
    of_blocks = left_right if turns else up_down
    of_parts = {
        "directed": mirrored(2 * n, 2 * n, turns, s),
        "undirected": undirected,
        # DPM: down-right, up-right, down-left, up-left
        "texture": of_blocks if scheme.texture == "vlfeat" else (up_down if turns else left_right),
        "blocks": [n * block + k for block in of_blocks for k in undirected],
        "zero": [0],
    }
    channels: list[int] = []
    for part in scheme.parts:
        channels += [len(channels) + k for k in of_parts[part]]
    return channels


def flip_permutation(s: HOGSpec, axis: str) -> list[int]:
    """Channel of the original cell that each channel of the mirrored one equals; ``axis`` is "x" or "y"."""
    turns = 2 if axis == "x" else 0  # left-right: 180° - Θ; up-down: -Θ
    channels = mirrored(s.bins, s.bins if s.signed else 2 * s.bins, turns, s)
    if isinstance(s.normalizer, FourBlockNorm):
        channels = flip_of_four_blocks(s, s.normalizer, turns)
    elif isinstance(s.normalizer, BlockNorm):
        high, wide = s.normalizer.block
        cells = [(y, wide - 1 - x) if axis == "x" else (high - 1 - y, x) for y in range(high) for x in range(wide)]
        channels = [(y * wide + x) * s.bins + k for y, x in cells for k in channels]
    return [colour * len(channels) + k for colour in range(s.colours) for k in channels]


def symmetric(s: HOGSpec) -> HOGSpec:
    """The dialect without gradients exactly along the border, which may tie between two bins."""
    return dataclasses.replace(s, border="ignore") if s.vote == "hard" and s.border == "reflect" else s


def has_window(s: HOGSpec) -> bool:
    """Whether a Gaussian weighs votes: those of blocks are off the middle, and tiled ones fit into no cells of 3."""
    return s.pooling.has_blocks or bool(getattr(s.pooling, "window", 0))


MIRRORED = [
    *(symmetric(s) for s in (make((3, 4)) for make in PRESETS.values()) if not has_window(s)),
    presets.paper((3, 4), bin_offset=0, border="zero", bins=8),
    presets.uoctti((3, 4), orientations=4),
    spec(cell_size=(3, 4), signed=True, bins=6, bin_offset=0.5, border="replicate", vote="hard"),
    spec(cell_size=(3, 4), mask="sobel", border="extrapolate", counterclockwise=True, colour="separate"),
    spec(cell_size=(3, 4), angle="opencv", signed=True, bins=10, border="gray", gamma="sqrt"),
    spec(cell_size=(3, 4), border="ignore", vote="hard", pooling=BilinearCells(edge_gain=2.0), bins=7, bin_offset=3.5),
    spec(cell_size=(4, 4), pooling=BoxCells(window=4), normalizer=BlockNorm((2, 3), (2, 1), "L2", 0.5)),
    SPECS["missing-floor"],
    symmetric(SPECS["unsigned-missing"]),
]


@pytest.mark.parametrize("s", MIRRORED, ids=lambda s: s.name)
@given(seed=seeds, rows=small, cols=small, channels=st.sampled_from([1, 3]), axis=st.sampled_from("xy"))
@a_few_times
def test_mirrored_image_has_permuted_descriptor(
    s: HOGSpec, seed: int, rows: int, cols: int, channels: int, axis: str
) -> None:
    image = noise(1, channels, *s.image_size(rows, cols), seed=seed)
    dim = -1 if axis == "x" else -2
    expected = hog(image, s).flip(dim - 1)[..., flip_permutation(s, axis)]
    # a float32's arccosine near 1 loses half of its digits
    tolerance = {"exact": 1e-12, "opencv": 1e-5, "vlfeat": 1e-3}[s.angle]
    assert_close(hog(image.flip(dim), s), expected, rtol=0, atol=tolerance)


@pytest.mark.slow
@given(seed=seeds, axis=st.sampled_from("xy"), name=st.sampled_from(["paper", "paper-robust", "uoctti"]))
def test_mirrored_bytes_have_mirrored_derivatives(seed: int, axis: str, name: str) -> None:
    """Full of gradients on bin centres, where a one-sided derivative would prefer a sense of rotation."""
    s = PRESETS[name](4)
    image = integers(1, 1, 8, 12, seed=seed, levels=6)
    dim = -1 if axis == "x" else -2
    weights = noise(1, 2, 3, s.channels, seed=seed)
    mirrored_weights = weights.flip(dim - 1)[..., flip_permutation(s, axis)]
    grad = torch.func.grad(lambda z: (weights * hog(z, s)).sum())(image)
    of_mirrored = torch.func.grad(lambda z: (mirrored_weights * hog(z, s)).sum())(image.flip(dim))
    assert_close(of_mirrored, grad.flip(dim), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", PRESETS)
@given(seed=seeds, down=st.integers(0, 1), right=st.integers(0, 1))
@a_few_times
def test_shift_by_a_cell_moves_the_cells(name: str, seed: int, down: int, right: int) -> None:
    s = PRESETS[name]((3, 4))
    if isinstance(s.pooling, BoxCells):
        s = dataclasses.replace(s, pooling=dataclasses.replace(s.pooling, window=0))  # which does not move
    # 2 by 2 cells are clean: the border of the image reaches one cell far into the votes, and the normaliser further
    reach = max(s.normalizer.reach() or 0, 1)
    n, first = (
        5 + 2 * reach + max(s.normalizer.footprint(0).extent - 2, 0),
        1 + reach - s.normalizer.footprint(0).margin,
    )
    scene = noise(1, 1, 3 * (n + 1), 4 * (n + 1), seed=seed)
    here = hog(scene[..., : 3 * n, : 4 * n], s)
    there = hog(scene[..., 3 * down : 3 * (n + down), 4 * right : 4 * (n + right)], s)
    there = there[:, first : first + 2, first : first + 2]
    here = here[:, first + down : first + down + 2, first + right : first + right + 2]
    if isinstance(s.normalizer, GlobalNorm):  # its one factor depends on what came into view
        here, there = here / here.norm(), there / there.norm()
    assert here.shape[1:3] == (2, 2)
    assert_close(there, here, rtol=0, atol=1e-12)


# --- contrast and brightness -----------------------------------------------------------------------------------------


@given(seed=seeds, contrast=st.floats(0.05, 1.0))
def test_contrast(seed: int, contrast: float) -> None:
    """Robust and UoCTTI norms remove it, up to ε; as printed, Eq. 7 leaves its square root."""
    image = noise(1, 1, 12, 12, seed=seed)
    exponents = dict.fromkeys(("paper-robust", "uoctti", "uoctti-hard", "vlfeat-dalaltriggs", "dpm", "dlib"), 0.0)
    exponents |= {"skimage": 0.0, "skimage-root": 0.0, "maskfeat": 0.0, "paper": 0.5}
    for name, exponent in exponents.items():
        s = PRESETS[name](4)
        assert_close(hog(contrast * image, s), contrast**exponent * hog(image, s), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", PRESETS)
def test_strong_edges_tell_the_contrast_where_the_normaliser_says_so(name: str) -> None:
    """About middle gray, which one dialect has beyond the border."""
    s, edges = PRESETS[name](4), noise(1, 1, 24, 24) - 0.5
    strong, half = (float(hog(128 / 255 + contrast * edges, s).norm()) for contrast in (1, 0.5))
    assert (half < 0.99 * strong) == s.normalizer.fixes_contrast


@pytest.mark.parametrize("name", ["aubry", "seeing3d"])
def test_faint_edges_show_the_contrast_beside_a_large_epsilon(name: str) -> None:
    s, edges = PRESETS[name](4), noise(1, 1, 24, 24) - 0.5
    faint, half = (float(hog(0.5 + contrast * edges, s).norm()) for contrast in (0.02, 0.01))
    assert half < 0.8 * faint


@pytest.mark.parametrize("name", [name for name, s in SPECS.items() if s.gamma == "none"])
@given(seed=seeds, brightness=st.floats(-0.5, 1.0))
@a_few_times
def test_brightness_changes_nothing(name: str, seed: int, brightness: float) -> None:
    s = SPECS[name]
    if s.border in ("zero", "gray"):
        s = dataclasses.replace(s, border="replicate")  # black beyond the border is a reference of brightness
    image = noise(1, 3, 9, 8, seed=seed)
    tolerance = {"exact": 1e-10, "opencv": 1e-5, "vlfeat": 1e-3}[s.angle]
    assert_close(hog(image + brightness, s), hog(image, s), rtol=0, atol=tolerance)


@given(seed=seeds)
def test_opposite_contrast_is_the_same_to_unsigned_bins(seed: int) -> None:
    image = noise(1, 1, 8, 12, seed=seed)
    assert_close(hog(1 - image, presets.paper(4)), hog(image, presets.paper(4)), rtol=0, atol=1e-12)
    positive, negative = hog(image, presets.uoctti(4)), hog(1 - image, presets.uoctti(4))
    assert_close(negative[..., :18].roll(9, dims=-1), positive[..., :18], rtol=0, atol=1e-12)
    assert_close(negative[..., 18:], positive[..., 18:], rtol=0, atol=1e-12)


# --- ranges ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPECS)
def test_input_is_not_changed(name: str) -> None:
    image = noise(1, 3, 8, 8)
    before = image.clone()
    hog(image, SPECS[name])
    assert (image == before).all()
