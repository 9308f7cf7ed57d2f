"""What channels are, and the order of OpenCV's vector."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch

from nablahog.hog import presets
from nablahog.hog.layout import channel_names, from_layout

# --- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", presets.__all__)
def test_each_channel_has_a_name_of_its_own(name: str) -> None:
    spec = presets.BY_NAME[name]
    names = channel_names(name)
    assert len(names) == len({*names}) == spec.channels


def test_names_say_what_a_channel_is() -> None:
    assert channel_names("paper")[:2] == ("10°", "30°")
    assert channel_names("opencv")[-1] == "cell 1, 1 of the block: 170°"
    assert channel_names("dpm")[27:] == (
        *(f"texture: block {block}" for block in ("down-right", "up-right", "down-left", "up-left")),
        "always 0",
    )
    assert channel_names("maskfeat")[9] == "green, 80°"


# --- OpenCV's vector -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("row", "col"), [(4, 4), (20, 12), (60, 40), (123, 59), (76, 4)])
def test_where_opencvs_entries_are(row: int, col: int) -> None:
    """A bright pixel: gradients to the right and left of it in bins 0 and 8, above and below it in bin 4."""
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "HOGDescriptor"):
        pytest.skip("OpenCV 5 has no HOG in its main package")
    image = np.zeros((128, 64), np.uint8)
    image[row, col] = 200
    vector = cv2.HOGDescriptor().compute(image)
    result = from_layout(torch.from_numpy(vector).unsqueeze(0), presets.opencv(), (128, 64))
    blocks = result.reshape(15, 7, 2, 2, 9)  # rows and columns of blocks, of cells in a block, bins

    expected = np.zeros((15, 7, 2, 2, 9), bool)
    votes = [(row, col - 1, (0, 8)), (row, col + 1, (0, 8)), (row - 1, col, (4,)), (row + 1, col, (4,))]
    for (y, x, bins), (i, j, k, m) in itertools.product(votes, np.ndindex(15, 7, 2, 2)):
        inside = 0 <= y - 8 * i < 16 and 0 <= x - 8 * j < 16
        near = abs(y - (8 * i + 8 * k + 3.5)) < 8 and abs(x - (8 * j + 8 * m + 3.5)) < 8
        if inside and near:
            expected[i, j, k, m, list(bins)] = True
    assert np.array_equal(blocks.numpy() > 1e-6, expected)

    for i, j, k, m, b in np.ndindex(blocks.shape):
        index = ((j * 15 + i) * 4 + m * 2 + k) * 9 + b  # blocks and cells column by column
        assert vector[index] == blocks[i, j, k, m, b]
