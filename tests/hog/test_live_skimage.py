"""scikit-image's own hog, here and now, with any parameters on any small image of bytes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from skimage import data
from skimage.feature import hog as skimage_hog

from nablahog.hog import hog, presets
from nablahog.hog.normalizers import BlockForm

TOLERANCE = 1e-6  # theirs adds the votes of a cell in float32, whatever the image

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Parameters:
    """What both take."""

    orientations: int = 9
    cell: tuple[int, int] = (8, 8)
    block: tuple[int, int] = (3, 3)
    norm: BlockForm = "L2-Hys"
    root: bool = False


def theirs(image: Image | Floats, p: Parameters) -> Floats:
    """(block rows, block columns, cell rows, cell columns, bins)."""
    colour = image.shape[2] > 1
    return skimage_hog(
        image if colour else image[..., 0],
        p.orientations,
        p.cell,
        p.block,
        p.norm,
        transform_sqrt=p.root,
        feature_vector=False,
        channel_axis=-1 if colour else None,
    )


def ours(image: Image | Floats, p: Parameters, value_range: float = 255.0) -> Floats:
    spec = presets.skimage(
        p.orientations,
        p.cell,
        p.block,
        p.norm,
        transform_sqrt=p.root,
        feature_vector=False,
        channel_axis=-1 if image.shape[2] > 1 else None,
        value_range=value_range,
    )
    unit = torch.from_numpy(image).double() / value_range
    return hog(unit.permute(2, 0, 1).unsqueeze(0), spec, layout="native")[0].numpy()


def undecided(image: Image, p: Parameters) -> Flags:
    """Pixels (height, width) whose channel or bin hangs on the last digit of what libraries round differently.

    Gradients of bytes are whole numbers, whose angle is a rational part of a turn only at multiples of 45°: both decide
    these alike.  Differences of roots, however, may be on any boundary: (√2 - 1) / 1 is the tangent of 22.5°, √1 / √3
    that of 30°.  There scikit-image's answer depends on how NumPy rounds its arctangent on this processor.  And of two
    channels of equal magnitude in different directions, the answer depends on how NumPy rounds hypot.
    """
    values = np.sqrt(image.astype(float)) if p.root else image.astype(float)
    gx, gy = np.zeros_like(values), np.zeros_like(values)
    gx[:, 1:-1] = values[:, 2:] - values[:, :-2]
    gy[1:-1] = values[2:] - values[:-2]
    turns = np.arctan2(gy, gx) * p.orientations / np.pi
    decided = (gx == 0) | (gy == 0) | (np.abs(gx) == np.abs(gy))
    edge = (np.abs(turns - turns.round()) < 1e-9) & ~decided
    squared = gx**2 + gy**2
    among = squared >= squared.max(axis=2, keepdims=True) * (1 - 1e-12)
    tie = np.zeros(image.shape[:2], bool)
    for magnitude in (squared, np.hypot(gx, gy)):
        most = magnitude.max(axis=2, keepdims=True)
        tie |= (among & (magnitude != most)).any(axis=2)
    return (edge & among).any(axis=2) | tie


def comparable(image: Image, p: Parameters) -> Flags:
    """Blocks (rows, columns) without an undecided pixel."""
    (high, wide), (down, right) = p.cell, p.block
    pixels = undecided(image, p)
    rows, cols = pixels.shape[0] // high, pixels.shape[1] // wide
    cells = pixels[: rows * high, : cols * wide].reshape(rows, high, cols, wide).any(axis=(1, 3))
    blocks = np.lib.stride_tricks.sliding_window_view(cells, (down, right))
    result: Flags = ~blocks.any(axis=(2, 3))
    return result


def largest_difference(image: Image, p: Parameters) -> float:
    """Of all blocks that can be compared."""
    expected, result = theirs(image, p), ours(image, p)
    assert result.shape == expected.shape
    return float(np.abs(result - expected)[comparable(image, p)].max(initial=0.0))


def picture(seed: int, size: tuple[int, int], colours: int, levels: int, smooth: bool) -> Image:
    """Noise of so many levels, of which few make many ties; or ramps of small steps."""
    generator = np.random.default_rng(seed)
    if smooth:
        steps = generator.integers(0, 4, (*size, colours))
        return np.minimum(steps.cumsum(axis=int(generator.integers(2))), 255).astype(np.uint8)
    return (generator.integers(0, levels, (*size, colours)) * (255 // (levels - 1))).astype(np.uint8)


parameters = st.builds(
    Parameters,
    st.integers(3, 18),
    st.tuples(st.integers(1, 9), st.integers(1, 9)),
    st.tuples(st.integers(1, 3), st.integers(1, 3)),
    st.sampled_from(["L1", "L1-sqrt", "L2", "L2-Hys"]),
    st.booleans(),
)


@given(
    p=parameters,
    more=st.tuples(st.integers(0, 30), st.integers(0, 30)),
    colours=st.sampled_from([1, 3]),
    levels=st.sampled_from([2, 3, 4, 8, 16, 256]),
    smooth=st.booleans(),
    seed=st.integers(0, 2**31 - 1),
)
@settings(max_examples=60)
@example(Parameters(), (30, 30), 3, 256, False, 0)
@example(Parameters(8, (1, 4), (1, 1), "L2", True), (20, 20), 1, 4, False, 1)
@example(Parameters(12, (2, 2), (2, 2), "L1", False), (25, 20), 3, 2, False, 2)
@example(Parameters(6, (7, 5), (2, 3), "L1-sqrt", True), (30, 25), 3, 256, True, 3)
def test_equals_skimage(
    p: Parameters, more: tuple[int, int], colours: int, levels: int, smooth: bool, seed: int
) -> None:
    height, width = (max(2, cell * block + n) for cell, block, n in zip(p.cell, p.block, more, strict=True))
    image = picture(seed, (height, width), colours, levels, smooth)
    if colours == 1 and not p.root:
        assert comparable(image, p).all()
    assert largest_difference(image, p) < TOLERANCE


@pytest.mark.parametrize("norm", ["L1", "L1-sqrt", "L2", "L2-Hys"])
def test_photographs(norm: BlockForm) -> None:
    for photograph in (data.camera()[:301, :299, np.newaxis], data.astronaut()[:200, :210], data.chelsea()):
        assert largest_difference(photograph, Parameters(norm=norm)) < TOLERANCE


@given(p=parameters, colours=st.sampled_from([1, 3]), seed=st.integers(0, 2**31 - 1))
def test_floating_point_images(p: Parameters, colours: int, seed: int) -> None:
    """As they are, in 0…1: without ties, nothing hangs on rounding."""
    image = np.random.default_rng(seed).random((p.cell[0] * p.block[0] + 11, p.cell[1] * p.block[1] + 12, colours))
    np.testing.assert_allclose(ours(image, p, 1.0), theirs(image, p), rtol=0, atol=TOLERANCE)
