"""What people pass to estimate_pose: taken as it is meant, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import estimate_pose
from nablahog.render import Mesh

from .common import model, photographed

IMAGE, BOX = photographed(model(), 40, 15)
HEIGHT, WIDTH = IMAGE.shape[1:]


def azimuth(photograph: Any = IMAGE, mesh: Any = None, **options: Any) -> float:
    known = {"box": BOX, "initial": (40, 15), "method": "exhaustive", **options}
    return estimate_pose(photograph, model() if mesh is None else mesh, **known).azimuth


def test_photographs_are_upright(tmp_path: Path) -> None:
    pixels = Image.fromarray((IMAGE[0].numpy() * 255).round().astype(np.uint8))
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was turned
    pixels.transpose(Image.Transpose.ROTATE_90).save(tmp_path / "a.png", exif=exif)
    with Image.open(tmp_path / "a.png") as photograph:
        assert azimuth(photograph) == azimuth(pixels)


def test_floats_in_0_to_255_are_warned_of_at_the_line_that_called() -> None:
    with pytest.warns(UserWarning, match=r"far beyond 0…1") as caught:
        azimuth(IMAGE * 255)
    assert caught[0].filename == __file__


def test_cameras_are_numbers_pairs_and_matrices() -> None:
    expected = azimuth(focal=300.0)
    matrix = np.array([[300.0, 0, WIDTH / 2], [0, 300, HEIGHT / 2], [0, 0, 1]])
    for focal in (np.float32(300), torch.tensor(300.0), (300, 300.0), matrix, torch.from_numpy(matrix)):
        assert azimuth(focal=focal) == expected
    with pytest.raises(ValueError, match="resize the photograph's height"):
        azimuth(focal=(300, 400))


def test_boxes_and_seeds_are_numbers_of_any_library() -> None:
    assert azimuth(box=np.array(BOX, np.float32), seed=np.int64(3)) == azimuth()
    with pytest.raises(ValueError, match="seed must be an integer"):
        azimuth(seed=0.5)


def test_masks_of_numpy_with_any_strides() -> None:
    mask = np.ones((HEIGHT, WIDTH), bool)
    assert azimuth(mask=mask[::-1]) == azimuth(mask=torch.from_numpy(mask))
    with pytest.raises(ValueError, match=r"write array\.filled"):
        azimuth(mask=np.ma.MaskedArray(mask, mask))


def test_what_requires_a_gradient_is_taken_without_it() -> None:
    mesh = model()
    learned = Mesh(mesh.vertices.clone().requires_grad_(), mesh.faces, mesh.brightness)
    assert azimuth(IMAGE.clone().requires_grad_(), learned) == azimuth()


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16])
def test_poses_do_not_follow_the_default_dtype(dtype: torch.dtype) -> None:
    expected = estimate_pose(IMAGE, model())
    torch.set_default_dtype(dtype)
    try:
        estimate = estimate_pose(IMAGE, model())
    finally:
        torch.set_default_dtype(torch.float32)
    assert torch.equal(estimate.crop_pose, expected.crop_pose)
