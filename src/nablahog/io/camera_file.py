"""Files of calibrated cameras: COLMAP's ``cameras.txt``, numbers as text, and JSON by the names of many programs."""

from __future__ import annotations

import json
import re
from typing import Any

from ..inputs.cameras import as_distortion, as_intrinsics
from ..inputs.numbers import as_numbers, as_size, is_finite, parse_numbers, shortened
from ..runtime.text import one_line
from .arrays import naming
from .camera_mapping import EXPECTED, CameraFile, as_rows, as_whole, read_camera_mapping
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
_EXAMPLE = '{"fx": 500, "fy": 500, "cx": 320, "cy": 240, "dist_coeffs": [0, 0, 0, 0, 0]}'


def read_camera_file(path: Readable) -> CameraFile:
    """The camera in a file: COLMAP's ``cameras.txt``, with one camera; or text (``.txt``) or JSON (``.json``).

    Other text is fx, fy, cx and cy, or the matrix, as NumPy's ``savetxt`` writes it.  JSON has fx, fy, cx and cy, and
    maybe k1, k2, p1, p2 and k3; or a matrix by the name of ``camera_matrix``, ``K`` or ``intrinsic_matrix``, as rows,
    nine numbers, or OpenCV's and ROS's object with ``data``, and maybe ``dist_coeffs`` or
    ``distortion_coefficients``; or is what :meth:`.PoseEstimate.save` writes.  Numbers are taken as they are.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it holds no camera, several, or one of another model, such as a fisheye; it contradicts itself; or
            it has numbers by names that are not known.
    """
    file = input_file(path)
    try:
        file.check("the file of a camera")
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}: write fx,fy,cx,cy in pixels, or the name of {EXPECTED}") from None
    if file.size > MOST_BYTES:
        raise ValueError(f"{file}: expected {EXPECTED}, got a file of {file.size:,} bytes")
    with naming(file):
        if file.ending not in (".json", ".txt"):
            raise ValueError(f"expected {EXPECTED}, got the ending {file.ending!r}{_advise(file)}")
        text = file.read().decode("utf-8-sig", errors="replace")
        return _read_json(text) if file.ending == ".json" else _read_text(text)


def _advise(file: InputFile) -> str:
    if file.ending == ".bin":
        return ": write cameras.txt by `colmap model_converter --output_type TXT`"
    if file.ending in (".yaml", ".yml", ".xml"):
        return f": write it by cv2.FileStorage('camera.json', 1), or its numbers as JSON, such as {_EXAMPLE}"
    return ""


def _read_text(text: str) -> CameraFile:
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#") and line.strip()]
    rows = tuple(tuple(map(parse_numbers, re.findall(r"[^][\s,;()]+", line))) for line in lines)
    numbers = tuple(number for row in rows for number in row)
    if numbers and all(map(is_finite, numbers)):
        return CameraFile(as_intrinsics("the text", as_rows(numbers)), None, ())
    if any(len(row) == 10 and all(map(is_finite, row[:9])) for row in rows):
        raise ValueError("expected COLMAP's cameras.txt, got its images.txt: write the name of the file beside it")
    return _read_colmap([line.split() for line in lines])


def _read_colmap(cameras: list[list[str]]) -> CameraFile:
    if len(cameras) != 1:
        raise ValueError(f"expected one camera, got {len(cameras)}: write the photograph's own into a file by itself")
    _, model, width, height, *numbers = (*cameras[0], "", "", "", "")[: max(4, len(cameras[0]))]
    if model not in _COLMAP:
        remedy = ": undistort the photographs by `colmap image_undistorter`" if model.isupper() else ""
        raise ValueError(
            f"expected fx, fy, cx, cy, or a camera ID MODEL WIDTH HEIGHT PARAMETERS of COLMAP's models "
            f"{', '.join(_COLMAP)}, got {shortened(' '.join(cameras[0]))}{remedy}"
        )
    names = _COLMAP[model].split()
    values = dict(zip(names, as_numbers(model, [*map(parse_numbers, numbers)], ", ".join(names)), strict=True))
    values |= {"fx": values["f"], "fy": values["f"]} if "f" in values else {}
    size = as_size("the size of the photographs", (as_whole(parse_numbers(height)), as_whole(parse_numbers(width))))
    intrinsics = as_intrinsics(model, [values[name] for name in ("fx", "fy", "cx", "cy")])
    coefficients = [values.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")]
    return CameraFile(intrinsics, as_distortion(model, coefficients) if "k1" in values else None, (size,))


def _read_json(text: str) -> CameraFile:
    try:
        whole = json.loads(text, object_pairs_hook=_as_dict)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected JSON, but it cannot be read: {one_line(error)}") from None
    if not isinstance(whole, dict):
        raise ValueError(f"expected {EXPECTED}, got {shortened(whole)}")
    return read_camera_mapping(whole)


def _as_dict(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError(f"one of the names {shortened([name for name, _ in pairs])} is there twice")
    return values
