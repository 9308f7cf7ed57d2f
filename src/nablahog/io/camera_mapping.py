"""A calibrated camera by names, as OpenCV, ROS, Open3D, RealSense, BOP, NeRF, this package and people write it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from ..inputs.cameras import as_distortion, as_intrinsics
from ..inputs.numbers import LONGEST_SIDE, as_integer, as_number, as_numbers, as_plain, as_size, is_finite, shortened
from .camera_names import (
    COEFFICIENT,
    DISTORTIONS,
    FISHEYES,
    GROUPS,
    HARMLESS,
    HEIGHTS,
    INTRINSICS,
    MATRICES,
    MODEL_KEYS,
    MODELS,
    PAIRS,
    PARTS,
    REMEDIES,
    SAME_WITHOUT_COEFFICIENTS,
    WIDTHS,
)

EXPECTED = "COLMAP's cameras.txt or JSON with fx, fy, cx, cy or camera_matrix, and maybe dist_coeffs"
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_SAME = 1e-4  # share by which numbers that are written twice may differ, from rounding
_NOTHING = 1e-9  # numbers below it are 0, but for rounding
_NEAR_MIDDLE, _OFF_MIDDLE = 0.05, 0.2  # of principal points, in halves of a side, as most cameras have them, and none


class CameraFile(NamedTuple):
    """A camera of a file, or of a mapping of the same names.

    Attributes:
        intrinsics: fx, fy, cx, cy, pixels.
        distortion: OpenCV's k1, k2, p1, p2, k3; None if it says none.
        sizes: heights and widths that its photographs may have, pixels; two where it does not say which of two sides
            is the height; none if it does not say any.
    """

    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, float, float, float, float] | None
    sizes: tuple[tuple[int, int], ...]


class _Statement(NamedTuple):
    """One value of a mapping: its plain name, its name as written, and itself, not None."""

    name: str
    written: str
    value: Any


def read_camera_mapping(values: Mapping[str, Any]) -> CameraFile:
    """The camera that a mapping describes by the names of :func:`.camera_file.read_camera_file`'s JSON.

    Raises:
        ValueError: it describes none, or one of another model, such as a fisheye; it contradicts itself; or it has
            numbers by a name that is not known.
    """
    statements = _list_statements(_find_photograph_camera(values))
    models = [_check_model(statement) for statement in statements]
    for statement in statements:
        _check_known(statement)
    intrinsics, distortion = _find_intrinsics(statements), _find_distortion(statements)
    if any(distortion or ()):
        if "none" in models:
            raise ValueError(
                f"it contradicts itself: the model is none, but the distortion {distortion}: leave one out"
            )
        if different := [model for model in models if model in SAME_WITHOUT_COEFFICIENTS]:
            raise ValueError(_refuse_model("the model", different[0]))
    return CameraFile(intrinsics, distortion, _find_sizes(statements, *intrinsics[2:]))


def _find_photograph_camera(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Of the figures of a pose, those of the photograph's camera; all else as it is."""
    if "photograph_camera" not in values:
        if "annotations" in values:
            raise ValueError("expected one camera, got a list of annotations: write one of them into a file by itself")
        return values
    camera = values["photograph_camera"]
    if isinstance(camera, Mapping):
        return camera
    if camera is not None or values.get("focal_length_from") == "assumed":
        raise ValueError(f"expected a calibrated camera, got a pose whose focal length was assumed: write {EXPECTED}")
    return {name: values[name] for name in ("intrinsics", "image_size") if name in values}


def _list_statements(values: Mapping[str, Any]) -> list[_Statement]:
    """All that is said, also within groups; of OpenCV's and ROS's matrices their numbers."""
    statements, groups = [], [values]
    for group in groups:  # which grows
        for written, value in group.items():
            name = _simplify(written)
            plain = as_plain(value["data"] if isinstance(value, Mapping) and "data" in value else value)
            if isinstance(plain, Mapping) and name == "roi":  # of its size, the size of the photograph says enough
                groups.append({part: plain[part] for part in ("x_offset", "y_offset") if part in plain})
            elif isinstance(plain, Mapping) and name in GROUPS:
                groups.append(plain)
            elif plain is not None:
                statements.append(_Statement(name, str(written), plain))
    return statements


def _simplify(name: object) -> str:
    return re.sub(r"[\W_]", "", str(name)).lower()


def _check_model(statement: _Statement) -> str | None:
    """The model that it names, if any; ValueError for one that is not read."""
    name, written, value = statement
    model = _simplify(value).removeprefix("distortion") if isinstance(value, str) else ""
    names_one = name in MODEL_KEYS or (name in DISTORTIONS and isinstance(value, str))
    is_fisheye = bool(value) and any(part in name or part in model for part in FISHEYES)
    known = isinstance(value, str) and model in (*MODELS, *SAME_WITHOUT_COEFFICIENTS)
    if is_fisheye or (names_one and not known):
        raise ValueError(_refuse_model(written, value))
    return model if names_one else None


def _refuse_model(written: str, value: object) -> str:
    return (
        "expected a camera of the model pinhole, radtan, plumb_bob, brown_conrady, opencv or none, got "
        f"{shortened(written)}: {shortened(value)}: undistort the photographs by the program that calibrated the "
        "camera, and leave model and distortion out"
    )


def _check_known(statement: _Statement) -> None:
    """Raises ValueError if it has numbers that may matter, by a name that is not known."""
    name, written, value = statement
    if name in (*MATRICES, *DISTORTIONS, *PARTS, *HEIGHTS, *WIDTHS, *PAIRS, *INTRINSICS) or COEFFICIENT.fullmatch(name):
        return
    if not _has_numbers(written, value) or (name.startswith("binning") and value == 1):
        return
    inside = isinstance(value, Mapping) or (
        isinstance(value, tuple) and any(isinstance(each, Mapping) for each in value)
    )
    remedy = REMEDIES.get(name) or (
        "write the photograph's camera into a file by itself"
        if inside
        else "write a distortion as dist_coeffs, [k1, k2, p1, p2, k3], and leave out what is not of the camera"
    )
    raise ValueError(f"expected nothing by the name of {shortened(written)}, got {shortened(value)}: {remedy}")


def _has_numbers(written: object, value: object) -> bool:
    """Whether there are numbers, not 0, by names of which it is not known that they do not matter."""
    plain = as_plain(value)
    if HARMLESS.fullmatch(_simplify(written)):
        return False
    if isinstance(plain, Mapping):
        return any(_has_numbers(name, each) for name, each in plain.items())
    if isinstance(plain, tuple):
        return any(_has_numbers("", each) for each in plain)
    if isinstance(plain, str):  # several, as "-0.3 0.1"
        return bool(re.fullmatch(r"[\[(\s]*([-+]?[\d.]+(e[-+]?\d+)?[,;\s\])]+){2,}", f"{plain} ", re.IGNORECASE))
    return isinstance(plain, int | float) and not isinstance(plain, bool) and not abs(plain) <= _NOTHING


def _find_intrinsics(statements: Iterable[_Statement]) -> tuple[float, float, float, float]:
    intrinsics = []
    names = tuple(dict.fromkeys(INTRINSICS.values()))
    for name, written, value in statements:
        if name in MATRICES:
            numbers = as_intrinsics(written, as_rows(value))
            intrinsics += [_Statement(part, written, number) for part, number in zip(names, numbers, strict=True)]
        elif name in INTRINSICS:
            intrinsics.append(_Statement(INTRINSICS[name], written, as_number(written, value)))
    numbers_by_name = _merge(intrinsics)
    if len(numbers_by_name) < len(names):
        raise ValueError(f"expected {EXPECTED}, got {shortened([statement.written for statement in statements])}")
    return as_intrinsics("fx, fy, cx, cy", [numbers_by_name[name] for name in names])


def _find_distortion(statements: Iterable[_Statement]) -> tuple[float, float, float, float, float] | None:
    coefficients = []
    for name, written, value in statements:
        if name in DISTORTIONS and value != () and not isinstance(value, str):
            parts = [*zip(_COEFFICIENTS, as_distortion(written, value), strict=False)]
        elif name in PARTS and not isinstance(value, str):
            of_all = PARTS[name][: len(value)] if isinstance(value, tuple) and len(value) > 1 else PARTS[name]
            parts = [*zip(of_all, as_numbers(written, value, ", ".join(of_all)), strict=True)]
        elif named := COEFFICIENT.fullmatch(name):
            parts = [(named[1], as_number(written, value))]
        else:
            continue
        coefficients += [_Statement(part, written, number) for part, number in parts]
    numbers_by_name = _merge(coefficients)
    for name, number in numbers_by_name.items():
        if number and name not in _COEFFICIENTS[:5]:
            raise ValueError(
                f"expected a distortion of OpenCV's {', '.join(_COEFFICIENTS[:5])}, got {name}: {number:g}: "
                "undistort the photographs with cv2.undistort, and leave the distortion out"
            )
    if not numbers_by_name:
        return None
    return as_distortion("the distortion", [numbers_by_name.get(name, 0.0) for name in _COEFFICIENTS[:5]])


def _find_sizes(statements: Iterable[_Statement], cx: float, cy: float) -> tuple[tuple[int, int], ...]:
    """Heights and widths: one, if it is known which side is the height."""
    pairs = [
        as_size(written, tuple(map(as_whole, value)) if isinstance(value, tuple) else value)
        for name, written, value in statements
        if name in PAIRS
    ]
    sides = [
        _Statement(
            "height" if name in HEIGHTS else "width", written, as_integer(written, as_whole(value), 1, LONGEST_SIDE)
        )
        for name, written, value in statements
        if name in (*HEIGHTS, *WIDTHS)
    ]
    named = _merge(sides)
    ordered = [(int(named["height"]), int(named["width"]))] if len(named) == 2 else []
    sizes = [*ordered, *pairs]
    if any(sorted(size) != sorted(sizes[0]) for size in sizes):
        raise ValueError(f"it contradicts itself: the photographs have the sizes {sizes}: leave the wrong one out")
    if ordered or not pairs:
        return tuple(ordered)
    one, other = pairs[0], pairs[0][::-1]
    near, far = (_measure_off_middle(size, cx, cy) for size in (one, other))
    if one == other or (near < _NEAR_MIDDLE and far > _OFF_MIDDLE):
        return (one,)
    return (other,) if far < _NEAR_MIDDLE and near > _OFF_MIDDLE else (one, other)


def _measure_off_middle(size: tuple[int, int], cx: float, cy: float) -> float:
    return max(abs(2 * cx / size[1] - 1), abs(2 * cy / size[0] - 1))


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


def as_whole(side: Any) -> Any:
    """Whole numbers of pixels as integers, also 128.0; all else as it is."""
    return int(side) if isinstance(side, float) and side.is_integer() else side


def as_rows(matrix: Any) -> Any:
    """Nine numbers as rows: row by row, or column by column, as Open3D writes them, which ends in cx, cy, 1."""
    if not isinstance(matrix, tuple) or len(matrix) != 9 or not all(map(is_finite, matrix)):
        return matrix
    rows = tuple(matrix[row : row + 3] for row in (0, 3, 6))
    return rows if rows[2] == (0, 0, 1) else tuple(zip(*rows, strict=True))
