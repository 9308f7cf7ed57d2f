"""What people pass to estimate_pose: taken as it is meant, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import estimate_pose

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
    all_intrinsics = matrix, matrix.tolist(), torch.from_numpy(matrix), (300, 300, WIDTH / 2, HEIGHT / 2)
    distortions = None, np.zeros((1, 5)), [0.0] * 4, torch.zeros(14)
    for intrinsics, distortion in zip(all_intrinsics, distortions, strict=True):
        assert azimuth(intrinsics=intrinsics, distortion=distortion) == expected
    assert azimuth(intrinsics={"K": matrix, "width": WIDTH, "height": HEIGHT}) == expected


MATRIX = [[300, 0, WIDTH / 2], [0, 300, HEIGHT / 2], [0, 0, 1]]


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"within": 0, "method": "best"}, "within must be a finite number above 0 and at most 180"),
        ({"principal_point": (3, 4)}, "`principal_point` needs a known focal length"),
        ({"focal": 300, "principal_point": (3, float("nan"))}, "principal_point must be 2 finite numbers x, y"),
        ({"focal": 20.0}, "in pixels, 0.1 to 100 diagonals of the photograph, got 20"),
        ({"focal": "far"}, "focal must be a finite number of pixels above 0, .*, or 'exif', got 'far'"),
        ({"intrinsics": (300, 300)}, "intrinsics must be a camera matrix"),
        ({"intrinsics": (300, -300, 90, 75)}, "intrinsics must be a camera matrix"),
        ({"intrinsics": (300, 900, 90, 75)}, "more than 2.5 times the other"),
        ({"intrinsics": (3, 3, 90, 75)}, "`intrinsics` must be in pixels, 0.1 to 100 diagonals"),
        ({"intrinsics": [[300, 2, 90], [0, 300, 75], [0, 0, 1]]}, r"must be \[\[fx, 0, cx\]"),
        ({"intrinsics": {"fx": 300}}, "`intrinsics`: expected .* JSON with fx, fy, cx, cy"),
        ({"intrinsics": {"K": MATRIX, "width": 9, "height": 9}}, "is for photographs of 9x9 pixels"),
        ({"intrinsics": {"K": MATRIX, "k1": 0}, "distortion": np.zeros(4)}, "expected no `distortion` beside it"),
        ({"intrinsics": "camera.bin"}, "camera.bin: no such file: write fx,fy,cx,cy in pixels"),
        ({"intrinsics": MATRIX, "focal": 300}, "leave `focal` and `principal_point` out"),
        ({"intrinsics": MATRIX, "principal_point": (90, 75)}, "leave `focal` and `principal_point` out"),
        ({"focal": MATRIX, "principal_point": (9, 7)}, "leave it out"),
        ({"focal": 300, "principal_point": (0.5, 0.5)}, "must be in pixels from the upper left corner"),
        ({"intrinsics": np.diag([300.0, 300, 1])}, "leave it out if it is not known"),
        ({"focal": 300, "principal_point": (1e9, 0)}, "within 100 diagonals"),
        ({"distortion": (0.1, 0, 0, 0)}, "`distortion` needs a known focal length"),
        ({"intrinsics": MATRIX, "distortion": 0.1}, "must be OpenCV's k1, k2, p1, p2, k3"),
        ({"intrinsics": MATRIX, "distortion": (0.1, 0.2)}, "write 0 for those that are not used"),
        ({"intrinsics": MATRIX, "distortion": (0.1, 0, 0, float("nan"))}, "must be OpenCV's k1, k2, p1, p2, k3"),
        ({"intrinsics": MATRIX, "distortion": np.ones(8)}, "undistort the photograph with cv2.undistort"),
        ({"intrinsics": MATRIX, "distortion": (-9, 0, 0, 0)}, "can be undone"),
    ],
)
def test_what_is_no_camera_is_refused(camera: dict[str, Any], message: str) -> None:
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        azimuth(**camera)
