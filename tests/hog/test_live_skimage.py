"""scikit-image's own hog, here and now, with any parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from skimage import data
from skimage.feature import hog as skimage_hog

from nablahog.hog import hog, presets
from nablahog.hog.normalizers.block import BlockForm

TOLERANCE = 1e-6  # theirs adds the votes of a cell in float32, whatever the image

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]


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


parameters = st.builds(
    Parameters,
    st.integers(3, 18),
    st.tuples(st.integers(1, 9), st.integers(1, 9)),
    st.tuples(st.integers(1, 3), st.integers(1, 3)),
    st.sampled_from(["L1", "L1-sqrt", "L2", "L2-Hys"]),
    st.booleans(),
)


@given(p=parameters, colours=st.sampled_from([1, 3]), seed=st.integers(0, 2**31 - 1))
def test_floating_point_images(p: Parameters, colours: int, seed: int) -> None:
    """As they are, in 0…1: without ties, nothing hangs on rounding."""
    image = np.random.default_rng(seed).random((p.cell[0] * p.block[0] + 11, p.cell[1] * p.block[1] + 12, colours))
    np.testing.assert_allclose(ours(image, p, 1.0), theirs(image, p), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("norm", ["L1", "L1-sqrt", "L2", "L2-Hys"])
@pytest.mark.parametrize("name", ["camera", "chelsea"])
def test_photographs(name: str, norm: BlockForm) -> None:
    """Of bytes, with ties; of colours their arithmetic decides some, whose blocks may differ."""
    image = np.atleast_3d(getattr(data, name)())[:301, :299]
    p = Parameters(norm=norm)
    difference = np.abs(ours(image, p) - theirs(image, p)).max(axis=(2, 3, 4))
    assert (difference < TOLERANCE).mean() > (0.99 if image.shape[2] > 1 else 0.9999)
