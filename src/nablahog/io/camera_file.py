"""Files of calibrated cameras: COLMAP's ``cameras.txt``, and JSON as OpenCV, ROS, Open3D and people write it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from ..inputs.cameras import as_distortion, as_intrinsics
from ..inputs.numbers import (
    LONGEST_SIDE,
    as_integer,
    as_number,
    as_numbers,
    as_plain,
    as_size,
    parse_numbers,
    shortened,
)
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
_MATRICES = ("cameramatrix", "intrinsicmatrix", "k", "mtx", "intrinsics")
"""Names of matrices and, as all below, of others, without capitals and what is neither letter nor digit."""
_DISTORTIONS = (
    *("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoefs", "dist", "distortion", "d"),
    *("distortionparameters", "distortionparams", "coefficients", "coeffs"),
)
_HEIGHTS, _WIDTHS = ("height", "imageheight", "h"), ("width", "imagewidth", "w")
_PAIRS = ("imagesize", "resolution")  # of sides in any order
_GROUPS = (*_MATRICES, *_DISTORTIONS, *_PAIRS, "camera", "projectionparameters")  # may hold what else is outside
_INTRINSICS, _COEFFICIENTS = ("fx", "fy", "cx", "cy"), ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_MODEL_KEYS = (
    *("model", "type", "modeltype", "cameramodel", "cameratype", "distortionmodel", "distortiontype"),
    *("lensmodel", "lenstype", "projection", "projectiontype", "projectionmodel"),
)
_MODELS = (
    *("plumbbob", "radtan", "radialtangential", "opencv", "brownconrady", "brown", "simpleradial", "radial"),
    *("pinhole", "simplepinhole", "perspective", "none", "null", ""),
)
"""Names of the model of five coefficients, and of none."""
_FISHEYES = ("fisheye", "equidist", "kannala")  # parts of names of models that are not read, by whatever key
_EXPECTED = "COLMAP's cameras.txt or JSON with fx, fy, cx, cy or camera_matrix, and maybe dist_coeffs"
_EXAMPLE = '{"fx": 500, "fy": 500, "cx": 320, "cy": 240, "dist_coeffs": [0, 0, 0, 0, 0]}'
_SAME = 1e-4  # share by which numbers that are written twice may differ, from rounding


class CameraFile(NamedTuple):
    """A camera of a file, or of a mapping of the same names.

    Attributes:
        intrinsics: fx, fy, cx, cy, pixels.
        distortion: OpenCV's k1, k2, p1, p2, k3; None if it says none.
        size: height and width of its photographs, pixels; None if it does not say it.
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
        ValueError: it holds no camera, several, or one of another model, such as a fisheye; or it contradicts itself.
    """
    file = input_file(path)
    try:
        file.check("the file of a camera")
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}: write fx,fy,cx,cy in pixels, or the name of {_EXPECTED}") from None
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
        return f": write it by cv2.FileStorage('camera.json', 1), or its numbers as JSON, such as {_EXAMPLE}"
    return ""


def _read_colmap(lines: Iterable[str]) -> CameraFile:
    cameras = [words for line in lines if (words := line.split()) and not words[0].startswith("#")]
    if len(cameras) != 1:
        raise ValueError(f"expected one camera, got {len(cameras)}: write the photograph's own into a file by itself")
    _, model, width, height, *numbers = (*cameras[0], "", "", "", "")[: max(4, len(cameras[0]))]
    if model not in _COLMAP:
        raise ValueError(
            f"expected a camera ID MODEL WIDTH HEIGHT PARAMETERS of COLMAP's models {', '.join(_COLMAP)}, got "
            f"{shortened(model)}: undistort the photographs by `colmap image_undistorter`"
        )
    names = _COLMAP[model].split()
    values = dict(zip(names, as_numbers(model, [*map(parse_numbers, numbers)], ", ".join(names)), strict=True))
    values |= {"fx": values["f"], "fy": values["f"]} if "f" in values else {}
    size = as_size("the size of the photographs", (_as_whole(parse_numbers(height)), _as_whole(parse_numbers(width))))
    intrinsics = as_intrinsics(model, [values[name] for name in _INTRINSICS])
    coefficients = [values.get(name, 0.0) for name in _COEFFICIENTS]
    return CameraFile(intrinsics, as_distortion(model, coefficients) if "k1" in values else None, size)


def _read_json(text: str) -> CameraFile:
    try:
        whole = json.loads(text, object_pairs_hook=_as_dict)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON, but it cannot be read: {one_line(error)}") from None
    if not isinstance(whole, dict):
        raise ValueError(f"expected {_EXPECTED}, got {shortened(whole)}")
    return read_camera_mapping(whole)


def _as_dict(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError(f"one of the names {shortened([name for name, _ in pairs])} is there twice")
    return values


class _Statement(NamedTuple):
    """One value of a mapping: its plain name, its name as written, and itself, not None."""

    name: str
    written: str
    value: Any


def read_camera_mapping(values: Mapping[str, Any]) -> CameraFile:
    """The camera that a mapping describes by the names of :func:`read_camera_file`'s JSON.

    Raises:
        ValueError: it describes none, or one of another model, such as a fisheye; or it contradicts itself.
    """
    statements = _list_statements(values)
    models = [_check_model(statement) for statement in statements]
    intrinsics, distortion = _find_intrinsics(statements), _find_distortion(statements)
    if "none" in models and any(distortion or ()):
        raise ValueError(f"it contradicts itself: the model is none, but the distortion {distortion}: leave one out")
    return CameraFile(intrinsics, distortion, _find_size(statements, *intrinsics[2:]))


def _list_statements(values: Mapping[str, Any]) -> list[_Statement]:
    """All that is said, also within groups; of OpenCV's and ROS's matrices their numbers."""
    statements, groups = [], [values]
    for group in groups:  # which grows
        for written, value in group.items():
            name = _simplify(written)
            plain = as_plain(value["data"] if isinstance(value, Mapping) and "data" in value else value)
            if isinstance(plain, Mapping) and name in _GROUPS:
                groups.append(plain)
            elif plain is not None:
                statements.append(_Statement(name, str(written), plain))
    return statements


def _simplify(name: object) -> str:
    return re.sub(r"[\W_]", "", str(name)).lower()


def _check_model(statement: _Statement) -> str | None:
    """The model that it names, if any; ValueError for one that is not read."""
    name, written, value = statement
    model = _simplify(value) if isinstance(value, str) else ""
    names_one = name in _MODEL_KEYS or (name in _DISTORTIONS and isinstance(value, str))
    is_fisheye = bool(value) and any(part in name or part in model for part in _FISHEYES)
    if is_fisheye or (names_one and (not isinstance(value, str) or model not in _MODELS)):
        raise ValueError(
            "expected a camera of the model pinhole, radtan, plumb_bob, brown_conrady, opencv or none, got "
            f"{shortened(written)}: {shortened(value)}: undistort the photographs by the program that calibrated the "
            "camera, and leave model and distortion out"
        )
    return model if names_one else None


def _find_intrinsics(statements: Iterable[_Statement]) -> tuple[float, float, float, float]:
    intrinsics = []
    for name, written, value in statements:
        if name in _MATRICES:
            numbers = as_intrinsics(written, _as_rows(value))
            intrinsics += [_Statement(part, written, number) for part, number in zip(_INTRINSICS, numbers, strict=True)]
        elif name in _INTRINSICS:
            intrinsics.append(_Statement(name, written, as_number(written, value)))
    numbers_by_name = _merge(intrinsics)
    if len(numbers_by_name) < len(_INTRINSICS):
        raise ValueError(f"expected {_EXPECTED}, got {shortened([statement.written for statement in statements])}")
    return as_intrinsics("fx, fy, cx, cy", [numbers_by_name[name] for name in _INTRINSICS])


def _find_distortion(statements: Iterable[_Statement]) -> tuple[float, float, float, float, float] | None:
    coefficients = []
    for name, written, value in statements:
        if name in _DISTORTIONS and value != () and not isinstance(value, str):
            numbers = as_distortion(written, value)
            coefficients += [
                _Statement(*each) for each in zip(_COEFFICIENTS, [written] * len(numbers), numbers, strict=False)
            ]
        elif name in _COEFFICIENTS:
            coefficients.append(_Statement(name, written, as_number(written, value)))
    numbers_by_name = _merge(coefficients)
    if not numbers_by_name:
        return None
    return as_distortion(", ".join(_COEFFICIENTS[:5]), [numbers_by_name.get(name, 0.0) for name in _COEFFICIENTS])


def _find_size(statements: Iterable[_Statement], cx: float, cy: float) -> tuple[int, int] | None:
    """Height and width; of a pair in any order those whose middle is nearer to the principal point."""
    sizes = []
    for name, written, value in statements:
        if name in _PAIRS:
            one, other = as_size(written, tuple(map(_as_whole, value)) if isinstance(value, tuple) else value)
            sizes.append(
                min((one, other), (other, one), key=lambda sides: math.hypot(sides[0] / 2 - cy, sides[1] / 2 - cx))
            )
    sides = [
        _Statement(
            "height" if name in _HEIGHTS else "width", written, as_integer(written, _as_whole(value), 1, LONGEST_SIDE)
        )
        for name, written, value in statements
        if name in (*_HEIGHTS, *_WIDTHS)
    ]
    named = _merge(sides)
    if len(named) == 2:
        sizes.insert(0, (int(named["height"]), int(named["width"])))
    if any(sorted(size) != sorted(sizes[0]) for size in sizes):
        raise ValueError(f"it contradicts itself: the photographs have the sizes {sizes}: leave the wrong one out")
    return sizes[0] if sizes else None


def _merge(statements: Iterable[_Statement]) -> dict[str, float]:
    """Numbers by name; ValueError if two of one name differ."""
    merged: dict[str, _Statement] = {}
    for statement in statements:
        name, written, value = statement
        first = merged.setdefault(name, statement)
        if not math.isclose(first.value, value, rel_tol=_SAME, abs_tol=1e-9):
            raise ValueError(
                f"it contradicts itself: {name} is {first.value:g} by {shortened(first.written)}, but {value:g} by "
                f"{shortened(written)}: leave the wrong one out"
            )
    return {name: statement.value for name, statement in merged.items()}


def _as_whole(side: Any) -> Any:
    """Whole numbers of pixels as integers, also 128.0; all else as it is."""
    return int(side) if isinstance(side, float) and side.is_integer() else side


def _as_rows(matrix: Any) -> Any:
    """Nine numbers as rows: row by row, or column by column, as Open3D writes them, which ends in cx, cy, 1."""
    if not isinstance(matrix, tuple) or len(matrix) != 9:
        return matrix
    rows = tuple(matrix[row : row + 3] for row in (0, 3, 6))
    return rows if rows[2] == (0, 0, 1) else tuple(zip(*rows, strict=True))
