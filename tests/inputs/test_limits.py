"""What is taken, and the first number beyond each limit, which is not."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.sparse import coo_array

from nablahog.inputs.arrays import advise_on_levels, as_array, as_mask, as_tensor
from nablahog.inputs.batches import as_batch
from nablahog.inputs.cameras import advise_on_size, as_camera, as_view
from nablahog.inputs.numbers import as_integer, as_number, as_seed, as_size
from nablahog.inputs.pil_images import pil_pixels
from nablahog.inputs.training_images import digest_of_images


def diagonals(count: float) -> Any:
    """A focal length, in diagonals of a photograph of 300x400 pixels."""
    return as_camera(300, 400, focal=500 * count)


LIMITS: dict[str, tuple[Callable[[Any], Any], list[Any], list[Any]]] = {
    "integer": (partial(as_integer, "bins", most=4096), [1, 4096], [0, 4097, True, 2.0]),
    "integer without limit": (partial(as_integer, "rows", least=-1), [-1, 10**30], [-2, 0.5]),
    "number": (partial(as_number, "share", least=0, most=1), [0, 1, 0.5], [-1e-9, 1 + 1e-9, float("nan"), False]),
    "number above": (partial(as_number, "scale", above=1, below=2), [1.001, 1.999], [1, 2]),
    "size": (partial(as_size, "image_size"), [(1, 1_000_000)], [(0, 1), (1, 1_000_001), (8, 8, 3), 8, (True, 8)]),
    "seed": (as_seed, [-(2**63), 2**64 - 1], [-(2**63) - 1, 2**64]),
    "view": (partial(as_view, "initial"), [(720, -90), (0, 90)], [(0, -90.001), (0, 90.001), (0,)]),
    "focal length": (diagonals, [0.1, 100], [0.0999, 100.1, 0, -1]),
    "two focal lengths": (partial(as_camera, 300, 400), [(400, 1000)], [(400, 1001)]),
    "principal point": (
        lambda point: as_camera(300, 400, focal=500, principal_point=point),
        [(200, 150), (1.001, 0), (200 + 50_000, 150)],
        [(0.5, 1), (1, 0), (200 + 50_001, 150)],
    ),
    "distortion": (
        lambda numbers: as_camera(300, 400, focal=500, distortion=numbers),
        [(0.1, 0, 0, 0), (0.1, 0, 0, 0, 0.2), (0.1, 0, 0, 0, 0.2, 0, 0, 0)],
        [(0.1, 0, 0), (0.1, 0, 0, 0, 0, 0.2)],
    ),
    "levels of floats": (
        lambda level: pil_pixels("image", Image.fromarray(np.array([[0, level]], np.float32))),
        [1, 1.09, -0.09, 16, 280],  # filters overshoot by a tenth
        [1.11, -0.11, 15.9, 281, np.nan, np.inf],
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_limits(name: str) -> None:
    read, taken, refused = LIMITS[name]
    for value in taken:
        read(value)
    for value in refused:
        with pytest.raises(ValueError, match=r"must (be|have)|expected levels in"):
            read(value)


@pytest.mark.parametrize(
    ("across", "down", "advice"),
    [
        (1, 1, None),
        (1.19, 1.19, None),
        (1.21, 1.21, "the middle of a photograph of about 363x484 pixels (height x width), not of 300x400"),
        (1.21, 1.21, "multiply all intrinsics by 0.826"),
        (0.5, 0.5, "multiply all intrinsics by 2"),
        (2, 1.91, "multiply all intrinsics by 0.5"),
        (2, 1.89, "as it is turned"),  # of another shape
        (1.59, 1, None),
        (1.61, 1, "as it is turned"),
        (1, 0.41, None),
        (1, 0.39, "as it is turned"),
        (2.01, 1, "outside the photograph of 300x400 pixels"),
        (1, -0.01, "outside the photograph"),
    ],
)
def test_a_principal_point_of_another_photograph(across: float, down: float, advice: str | None) -> None:
    """In a photograph of 300x400 pixels, in halves of its sides."""
    said = advise_on_size(300, 400, 200 * across, 150 * down)
    assert said is None if advice is None else said is not None and advice in said


@pytest.mark.parametrize("shape", [(1, 4, 4), (3, 80, 90), (1, 5, 2000)])
@pytest.mark.parametrize(
    ("level", "far"), [(2, False), (2.01, True), (-0.5, False), (-0.51, True), (255, True), (-np.inf, False)]
)
def test_levels_far_beyond_those_of_images(shape: tuple[int, ...], level: float, far: bool) -> None:
    """As filters overshoot, or are those of 0…255 or -1…1; of large images, of which some pixels are looked at, too."""
    image = torch.full(shape, 0.5)
    image[:, 1:, 1:] = level
    assert bool(advise_on_levels(image)) == far


def test_arrays() -> None:
    """A column of objects is one of numbers, but None is no NaN; memory is taken in whatever order it is."""
    rows = np.array([[1, 2.5], [3, 4]], object)
    assert as_array("rows", rows).dtype == np.float64
    with pytest.raises(TypeError, match="rows must"):
        as_array("rows", np.array([1.0, None], object))
    with pytest.raises(TypeError, match=r"rows must .*: write its toarray\(\)$"):
        as_array("rows", coo_array(np.eye(2)))
    numbers = np.zeros(4, np.dtype([("a", np.float32), ("b", np.int8)]))["a"]  # 5 bytes from one to the next
    numbers[:] = [1, 2, 3, 4]
    for array in (numbers, numbers[::-1], numbers[::2], np.array([1, 2], ">f4")):
        assert as_tensor("numbers", array).tolist() == array.tolist()


@pytest.mark.parametrize(
    ("images", "words"),
    [
        (Image.new("L", (4, 4)), r"got a PIL image: write \[image\]$"),
        ([], "images must hold images, got none"),
        (np.empty(0, object), "images must hold images, got none"),
        (np.array([[[0, np.nan]]]), "must be finite"),
        ([np.zeros((1, 1)), np.array([[np.inf]])], r"images\[1\] must be finite"),
    ],
)
def test_no_batch(images: Any, words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        as_batch("images", images)


def test_a_camera() -> None:
    camera = as_camera(300, 400, focal=500)
    assert camera is not None
    assert camera.matrix == [[500, 0, 200], [0, 500, 150], [0, 0, 1]]
    assert camera.is_ideal
    for other in (as_camera(300, 400, (500, 501)), as_camera(300, 400, 500, distortion=(0, 0.1, 0, 0))):
        assert other is not None
        assert not other.is_ideal


def test_pil_images_are_over_white() -> None:
    """Gray 51 of 255, all of it, half of it, nothing of it."""
    image = Image.fromarray(np.array([[[51, 255], [51, 51], [51, 0]]], np.uint8), "LA")
    np.testing.assert_allclose(pil_pixels("image", image), [[0.2, 0.2 * 0.2 + 0.8, 1]], atol=1e-6)
    deep = Image.fromarray(np.array([[0, 13107, 65535]], np.uint16))
    np.testing.assert_allclose(pil_pixels("image", deep), [[0, 0.2, 1]], atol=1e-6)


def test_a_mask() -> None:
    mask = as_mask("mask", np.array([[0, 1], [0, 1]]) > 0, (2, 2))
    assert mask.tolist() == [[False, True], [False, True]]
    with pytest.raises(ValueError, match="true nowhere"):
        as_mask("mask", np.zeros((2, 2), bool), (2, 2))
    with pytest.raises(ValueError, match=r"got bool of shape \(2, 3\)$"):
        as_mask("mask", np.ones((2, 3), bool), (2, 2))
    with pytest.raises(ValueError, match=r"write mask > 0$"):
        as_mask("mask", np.ones((2, 2), np.uint8), (2, 2))


def test_a_digest_is_of_names_sizes_and_pixels() -> None:
    first = {"a": torch.zeros(2, 3), "b": torch.ones(2, 2)}
    others = [
        {"a": torch.zeros(3, 2), "b": torch.ones(2, 2)},
        {"a": torch.zeros(2, 3), "c": torch.ones(2, 2)},
        {"a": torch.zeros(2, 3), "b": torch.zeros(2, 2)},
    ]
    assert len({digest_of_images(images) for images in (first, *others)}) == 4
    assert digest_of_images(dict(reversed(first.items()))) == digest_of_images(first)
