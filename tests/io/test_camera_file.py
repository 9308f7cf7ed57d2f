"""Files of cameras, as COLMAP, OpenCV, ROS, Open3D, RealSense, BOP and NeRF write them."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest

from nablahog.io import camera_file
from nablahog.io.camera_file import read_camera_file
from nablahog.io.camera_mapping import read_camera_mapping
from nablahog.io.input_file import InputFile

FOUR = (520.5, 515.25, 320.5, 240.25)
MATRIX = [[520.5, 0, 320.5], [0, 515.25, 240.25], [0, 0, 1]]
FLAT = [number for row in MATRIX for number in row]
FIVE = [-0.3, 0.1, 0.001, -0.002, 0.01]
ROS = {
    "image_width": 640,
    "image_height": 480,
    "camera_matrix": {"rows": 3, "cols": 3, "data": FLAT},
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": FIVE},
    "rectification_matrix": {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
}
COLMAP = "# Camera list\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"


def read(content: Any, name: str = "camera.json") -> Any:
    text = content if isinstance(content, str) else json.dumps(content)
    return read_camera_file(InputFile(name, text.encode()))


@pytest.mark.parametrize(
    ("content", "distortion", "size"),
    [
        (dict(zip(("fx", "fy", "cx", "cy"), FOUR, strict=True)), None, None),
        ({"fx": 520.5, "fy": 515.25, "cx": 320.5, "cy": 240.25, "k1": -0.3, "p2": 0.1}, (-0.3, 0, 0, 0.1, 0), None),
        ({"K": MATRIX, "width": 640, "height": 480}, None, (480, 640)),
        ({"K": MATRIX, "width": 1, "height": 1}, None, (1, 1)),
        ({"K": FLAT, "D": FIVE, "distortion_model": "plumb_bob"}, FIVE, None),
        ({"camera_matrix": MATRIX, "dist_coeffs": [FIVE]}, FIVE, None),
        ({"mtx": MATRIX, "dist": [[each] for each in FIVE[:4]]}, (*FIVE[:4], 0), None),
        (ROS, FIVE, (480, 640)),
        (
            {"width": 640, "height": 480, "intrinsic_matrix": [520.5, 0, 0, 0, 515.25, 0, 320.5, 240.25, 1]},
            None,
            (480, 640),
        ),
        ({"K": MATRIX, "D": [*FIVE, 0, 0, 0]}, FIVE, None),
        ({"K": MATRIX, "resolution": [640, 480]}, None, (480, 640)),
        ({"K": MATRIX, "image_size": [480, 640]}, None, (480, 640)),
        ({"K": MATRIX, "w": 640.0, "h": 480, "image_size": [640, 480], "distortion_model": None}, None, (480, 640)),
        ({"K": MATRIX, "fx": 520.55, "dist": FIVE, "k1": -0.3}, FIVE, None),  # but for rounding
        (
            {"camera_model": "pinhole", "intrinsics": FOUR, "distortion_model": "radtan", "distortion_coeffs": FIVE},
            FIVE,
            None,
        ),
        ({"K": MATRIX, "distortion": {"model": "Brown-Conrady", "k1": -0.3, "k2": 0.1}}, (-0.3, 0.1, 0, 0, 0), None),
        ({"camera": {"model": "OPENCV", "K": MATRIX, "is_fisheye": False}}, None, None),
        ({"K": MATRIX, "distortion": "none", "type": "SIMPLE_PINHOLE", "D": []}, None, None),
        *(({"K": MATRIX, key: FIVE}, FIVE, None) for key in ("dist_coeff", "dist_coefficients", "distortionCoeff")),
        ({"K": MATRIX, "RadialDistortion": FIVE[:2], "TangentialDistortion": FIVE[2:4]}, (*FIVE[:4], 0), None),
        ({"K": MATRIX, "distortion": {"radial": [*FIVE[:2], 0.01], "tangential": FIVE[2:4]}}, FIVE, None),
        ({"K": MATRIX, "lens": {"k1": -0.3}, "distortion_k2": 0.1}, (-0.3, 0.1, 0, 0, 0), None),
        ({"K": [[520.5, 1e-12, 320.5], *MATRIX[1:]], "skew": 0, "k4": 0.0}, (0.0,) * 5, None),
        ({"cam_K": FLAT, "depth_scale": 0.1, "cam_R_w2c": [1, 0, 0, 0, 1, 0, 0, 0, 1]}, None, None),
        ({"class_name": "x", "extrinsic": FLAT, "intrinsic": {"intrinsic_matrix": FLAT}}, None, None),
        (
            {"fx": 520.5, "fy": 515.25, "ppx": 320.5, "ppy": 240.25, "model": "distortion.inverse_brown_conrady"},
            None,
            None,
        ),
        (
            {"w": 640, "h": 480, "fl_x": 520.5, "fl_y": 515.25, "cx": 320.5, "cy": 240.25, "camera_angle_x": 1.1}
            | {"aabb_scale": 16, "frames": [{"file_path": "a.png", "sharpness": 9.1, "transform_matrix": MATRIX}]},
            None,
            (480, 640),
        ),
        ({**ROS, "roi": {"x_offset": 0, "height": 480, "do_rectify": True}, "binning_x": 1}, FIVE, (480, 640)),
        (
            {**ROS, "nframes": 30, "calibration_time": "Mon 9", "avg_reprojection_error": 0.3, "rms": 1},
            FIVE,
            (480, 640),
        ),
        ({"photograph_camera": {"camera_matrix": MATRIX, "dist_coeffs": FIVE}, "model": "chair", "x": 9}, FIVE, None),
        (
            {"photograph_camera": None, "intrinsics": MATRIX, "image_size": [480, 640], "focal_length_from": "given"}
            | {"model": "chair", "distance": 3.0},
            None,
            (480, 640),
        ),
    ],
)
def test_json(content: Any, distortion: Any, size: Any) -> None:
    camera = read(content)
    assert camera.intrinsics == FOUR
    assert camera.distortion == (None if distortion is None else tuple(distortion))
    assert camera.sizes == (() if size is None else (size,))
    assert read_camera_mapping({name: as_array(value) for name, value in content.items()}) == camera


def as_array(value: Any) -> Any:
    return np.array(value) if isinstance(value, list) else value


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        *(
            ({key: "OPENCV_FISHEYE"}, f"{key}.*undistort the photographs")
            for key in ("camera_model", "model", "type", "distortion_type", "Projection-Type")
        ),
        *(
            ({"distortion_model": name}, "distortion_model.*undistort the photographs")
            for name in ("equidistant", "KannalaBrandt8", "fisheye", "FOV", "omni", 3)
        ),
        *(
            ({key: "THIN_PRISM_FISHEYE"}, f"{key}.*undistort the photographs")
            for key in ("camera_model", "lens", "name")
        ),
        ({"is_fisheye": True}, "is_fisheye.*undistort the photographs"),
        ({"distortion": {"model": "equi", "k1": 0.1}}, "undistort the photographs"),
        ({"camera": {"type": "KANNALA_BRANDT"}}, "undistort the photographs"),
        ({"distortion": "inverse_brown_conrady"}, "undistort the photographs"),
        ({"k1": 0.5}, "contradicts itself"),
        ({"fx": 520.56}, "contradicts itself"),
        ({"camera_matrix": [[9, 0, 320.5], [0, 9, 240.25], [0, 0, 1]]}, "contradicts itself"),
        ({"distortion": {"p2": 0.5}}, "contradicts itself"),
        ({"distortion_model": "none"}, "contradicts itself"),
        ({"height": 480, "width": 640, "image_size": [640, 479]}, "contradicts itself"),
        ({"h": 480, "image_height": 479}, "contradicts itself"),
        ({"D": None, "dst": FIVE}, "dst.*write a distortion as dist_coeffs"),
        ({"D": None, "distortion_parms": "-0.3 0.1"}, "distortion_parms.*write a distortion as dist_coeffs"),
        ({"new_camera_matrix": MATRIX}, "new_camera_matrix.*leave out"),
        ({"skew": 12.0}, "skew.*without skew"),
        ({"s": 2}, "'s'.*without skew"),
        ({"binning_x": 2}, "binning_x.*`intrinsics` as fx,fy,cx,cy of the photograph as it is"),
        ({"roi": {"x_offset": 100, "height": 0}}, "x_offset.*`intrinsics` as fx,fy,cx,cy of the photograph as it is"),
        ({"depth_camera": {"fx": 500}}, "depth_camera.*by itself"),
        ({"frames": [{"fl_x": 500}]}, "frames.*by itself"),
        ({"focal_length": 500}, "focal_length.*write fx and fy"),
    ],
)
def test_what_a_camera_matrix_does_not_go_with_is_refused(statement: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read({"K": MATRIX, "D": FIVE, **statement})


def test_the_order_of_a_size_is_not_guessed() -> None:
    """A principal point that is off the middle does not tell; one that is near the middle of one order does."""
    for cx, cy, either in ((250, 260, True), (325, 245, False)):
        matrix = [[900, 0, cx], [0, 880, cy], [0, 0, 1]]
        for pair in ([480, 640], [640, 480]):
            sizes = read({"K": matrix, "image_size": pair}).sizes
            assert sorted(sizes) == ([(480, 640), (640, 480)] if either else [(480, 640)])
        assert read({"K": matrix, "image_size": {"width": 640, "height": 480}}).sizes == ((480, 640),)


@pytest.mark.parametrize("text", ["900,880,325,245\n", "9e2 0 325\n0 880 245\n0 0 1\n", "[900, 880, 325, 245]"])
def test_text_is_read_as_the_option_is(text: str) -> None:
    assert read(text, "camera.txt") == ((900, 880, 325, 245), None, ())


def test_the_json_that_opencv_writes(tmp_path: Any) -> None:
    storage = cv2.FileStorage(str(tmp_path / "calibration.json"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array([FIVE]))
    storage.release()
    assert read_camera_file(tmp_path / "calibration.json") == (FOUR, tuple(FIVE), ((480, 640),))


@pytest.mark.parametrize(
    ("line", "intrinsics", "distortion"),
    [
        ("SIMPLE_PINHOLE 640 480 500 320 240", (500, 500, 320, 240), None),
        ("PINHOLE 640.0 480 520.5 515.25 320.5 240.25", FOUR, None),
        ("SIMPLE_RADIAL 640 480 500 320 240 -0.1", (500, 500, 320, 240), (-0.1, 0, 0, 0, 0)),
        ("RADIAL 640 480 500 320 240 -0.1 0.02", (500, 500, 320, 240), (-0.1, 0.02, 0, 0, 0)),
        ("OPENCV 640 480 520.5 515.25 320.5 240.25 -0.3 0.1 0.001 -0.002", FOUR, (*FIVE[:4], 0)),
    ],
)
def test_colmap(line: str, intrinsics: Any, distortion: Any) -> None:
    assert read(f"{COLMAP}1 {line}\n\n  # 1\n", "cameras.txt") == (intrinsics, distortion, ((480, 640),))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cameras.txt", f"{COLMAP}1 PINHOLE 9 9 5 5 4 4\n2 PINHOLE 9 9 5 5 4 4\n", "expected one camera, got 2"),
        ("cameras.txt", COLMAP, "expected one camera, got 0"),
        ("images.txt", f"{COLMAP}1 0.8 0.1 0.2 0.3 1 2 3 1 a.jpg\n", "got its images.txt"),
        ("camera.txt", "fx = 900", "expected fx, fy, cx, cy, or a camera ID MODEL"),
        ("poses.json", '{"annotations": []}', "write one of them into a file by itself"),
        ("pose.json", '{"photograph_camera": null, "focal_length_from": "assumed"}', "focal length was assumed"),
        ("camera.json", '{"0": {"cam_K": [5, 0, 4, 0, 5, 4, 0, 0, 1]}}', "camera into a file by itself"),
        ("cameras.txt", "1 OPENCV_FISHEYE 640 480 5 5 4 4 0 0 0 0", "colmap image_undistorter"),
        ("cameras.txt", "1 PINHOLE 640 480 5 5 4", "must be 4 finite numbers fx, fy, cx, cy"),
        ("cameras.txt", "1 PINHOLE wide 480 5 5 4 4", "must be"),
        ("cameras.txt", "1 PINHOLE", "must be"),
        ("cameras.txt", "1 PINHOLE 640 480 5 5 4 a", "must be 4 finite numbers fx, fy, cx, cy, got .*'a'"),
        ("camera.json", '{"fx": 1%s, "fy": 5, "cx": 4, "cy": 4}' % ("0" * 400), "fx must be a finite number"),
        ("camera.json", json.dumps({"K": MATRIX, "width": "640", "height": 480}), "width must be an integer"),
        ("camera.json", '{"fx": 5, "fy": 5, "cx": 4, "cy": 4, "fx": 6}', "there twice"),
        ("camera.csv", "", r"got the ending '\.csv'$"),
        ("cameras.bin", "", "model_converter --output_type TXT"),
        ("camera.yaml", "", "or its numbers as JSON, such as"),
        ("camera.json", "{", "expected JSON, but it cannot be read: Expecting property name"),
        ("camera.json", "[1, 2]", r"expected COLMAP's cameras.txt or JSON with fx, fy, cx, cy or camera_matrix"),
        ("camera.json", '{"fx": 3}', "got .*fx"),
        ("camera.json", '{"K": [[5, 1, 4], [0, 5, 4], [0, 0, 1]]}', r"must be \[\[fx, 0, cx\]"),
        ("camera.json", '{"K": "wide"}', "must be a camera matrix"),
        ("camera.json", json.dumps({**ROS, "distortion_model": "equidistant"}), "undistort the photographs"),
        ("camera.json", json.dumps({"K": MATRIX, "D": [1.0] * 8}), "got a model of 8 numbers"),
        ("camera.json", json.dumps({"fx": 5, "fy": 5, "cx": 4, "cy": 4, "k1": 0.1, "k4": 1}), "got k4: 1: undistort"),
    ],
)
def test_what_is_no_camera_is_refused(name: str, content: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read(content, name)
    assert str(caught.value).startswith(f"{name}: ")


def test_the_largest_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_file, "MOST_BYTES", 15)
    assert read("900,880,325,245", "camera.txt").intrinsics == (900, 880, 325, 245)
    with pytest.raises(ValueError, match=r"camera\.txt: expected .*, got a file of 16 bytes"):
        read("900,880,325,245\n", "camera.txt")
