"""Files of calibrated cameras: COLMAP's ``cameras.txt``, and JSON as OpenCV, ROS, Open3D and people write it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from ..inputs.cameras import as_distortion, as_intrinsics
from ..inputs.numbers import as_numbers, as_plain, as_size, shortened
from ..runtime.text import one_line
from .arrays import naming
from .input_file import InputFile, Readable, input_file

MOST_BYTES = 2**24  # of a file that is read
_COLMAP = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
}
"""The parameters of COLMAP's models."""
_MATRICES = ("camera_matrix", "intrinsic_matrix", "K", "k", "mtx", "intrinsics")
_DISTORTIONS = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "dist", "distortion", "D", "d")
_SIZES = (("height", "width"), ("image_height", "image_width"), ("h", "w"))
_PAIRS = ("image_size", "resolution")  # of sides in any order
_MODELS = ("plumb_bob", "radtan", "opencv", "brown_conrady")  # names of the model of five coefficients
_EXPECTED = "COLMAP's cameras.txt or JSON with fx, fy, cx, cy or camera_matrix, and maybe dist_coeffs"


class CameraFile(NamedTuple):
    """A camera of a file.

    Attributes:
        intrinsics: fx, fy, cx, cy, pixels.
        distortion: OpenCV's k1, k2, p1, p2, k3; None if the file says none.
        size: height and width of its photographs, pixels; None if the file does not say it.
    """

    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, float, float, float, float] | None
    size: tuple[int, int] | None


def read_camera_file(path: Readable) -> CameraFile:
    """The camera in a file: COLMAP's ``cameras.txt``, with one camera, or JSON (``.json``).

    JSON has fx, fy, cx and cy, and maybe k1, k2, p1, p2 and k3; or a matrix by the name of ``camera_matrix``, ``K`` or
    ``intrinsic_matrix``, as rows, nine numbers, or OpenCV's and ROS's object with ``data``, and maybe ``dist_coeffs``
    or ``distortion_coefficients``.  Numbers are taken as they are.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it holds no camera, several, or one of another model.
    """
    file = input_file(path)
    file.check("the file of a camera")
    if file.size > MOST_BYTES:
        raise ValueError(f"{file}: expected {_EXPECTED}, got a file of {file.size:,} bytes")
    with naming(file):
        if file.ending not in (".json", ".txt"):
            raise ValueError(f"expected {_EXPECTED}, got the ending {file.ending!r}{_advise(file)}")
        text = file.read().decode("utf-8-sig", errors="replace")
        return _read_json(text) if file.ending == ".json" else _read_colmap(text.splitlines())


def _advise(file: InputFile) -> str:
    if file.ending == ".bin":
        return ": write cameras.txt by `colmap model_converter --output_type TXT`"
    if file.ending in (".yaml", ".yml", ".xml"):
        return ": write its numbers as JSON"
    return ""


def _read_colmap(lines: Iterable[str]) -> CameraFile:
    cameras = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    if len(cameras) != 1:
        raise ValueError(f"expected one camera, got {len(cameras)}: write the photograph's own into a file by itself")
    _, model, width, height, *numbers = (*cameras[0], "", "", "", "")[: max(4, len(cameras[0]))]
    if model not in _COLMAP:
        raise ValueError(
            f"expected a camera ID MODEL WIDTH HEIGHT PARAMETERS of COLMAP's models {', '.join(_COLMAP)}, got "
            f"{shortened(model)}: undistort the photographs by `colmap image_undistorter`"
        )
    names = _COLMAP[model].split()
    values = dict(zip(names, as_numbers(model, [*map(float, numbers)], ", ".join(names)), strict=True))
    values |= {"fx": values["f"], "fy": values["f"]} if "f" in values else {}
    size = as_size("the size of the photographs", (int(height), int(width)))
    return CameraFile(_named_intrinsics(values), _named_distortion(values), size)


def _read_json(text: str) -> CameraFile:
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON, but it cannot be read: {one_line(error)}") from None
    if not isinstance(whole, dict):
        raise ValueError(f"expected {_EXPECTED}, got {shortened(whole)}")
    matrix, coefficients = _first(whole, _MATRICES), _first(whole, _DISTORTIONS)
    if isinstance(matrix, dict):  # all below its name
        whole, matrix = {**whole, **matrix}, None
    model = whole.get("distortion_model", _MODELS[0])
    if not isinstance(model, str) or model.lower() not in ("", "none", *_MODELS):
        raise ValueError(
            f"expected a distortion_model from {', '.join(_MODELS)}, got {shortened(model)}: undistort the photographs "
            "by the program that calibrated the camera, and leave the distortion out"
        )
    distortion = None if coefficients in (None, []) else as_distortion("the distortion", coefficients)
    intrinsics = _named_intrinsics(whole) if matrix is None else as_intrinsics("the matrix", _as_rows(matrix))
    return CameraFile(
        intrinsics, _named_distortion(whole) if distortion is None else distortion, _find_size(whole, *intrinsics[2:])
    )


def _find_size(whole: Mapping[str, Any], cx: float, cy: float) -> tuple[int, int] | None:
    """Height and width; of a pair in any order those whose middle is nearer to the principal point."""
    name = "the size of the photographs"
    size = next(((whole[high], whole[wide]) for high, wide in _SIZES if high in whole and wide in whole), None)
    if size is not None:
        return as_size(name, size)
    pair = _first(whole, _PAIRS)
    if pair is None:
        return None
    one, other = as_size(name, pair)
    return min((one, other), (other, one), key=lambda sides: math.hypot(sides[0] / 2 - cy, sides[1] / 2 - cx))


def _first(whole: Mapping[str, Any], names: Iterable[str]) -> Any:
    """The value of the first of some names that is there; of OpenCV's and ROS's matrices their numbers."""
    value = next((whole[name] for name in names if name in whole), None)
    return value["data"] if isinstance(value, dict) and "data" in value else value


def _as_rows(matrix: Any) -> Any:
    """Nine numbers as rows: row by row, or column by column, as Open3D writes them, which ends in cx, cy, 1."""
    plain = as_plain(matrix)
    if not isinstance(plain, tuple) or len(plain) != 9:
        return plain
    rows = tuple(plain[row : row + 3] for row in (0, 3, 6))
    return rows if rows[2] == (0, 0, 1) else tuple(zip(*rows, strict=True))


def _named_intrinsics(values: Mapping[str, Any]) -> tuple[float, float, float, float]:
    names = ("fx", "fy", "cx", "cy")
    if any(name not in values for name in names):
        raise ValueError(f"expected {_EXPECTED}, got {shortened([*values])}")
    return as_intrinsics("fx, fy, cx, cy", [values[name] for name in names])


def _named_distortion(values: Mapping[str, Any]) -> tuple[float, float, float, float, float] | None:
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    if not any(name in values for name in names):
        return None
    return as_distortion(", ".join(names[:5]), [values.get(name, 0.0) for name in names])
