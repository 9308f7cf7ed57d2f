"""What ``nablahog pose``, and the view of the page, can be asked."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, get_args

from ..inputs.cameras import as_distortion, as_focal, as_intrinsics, as_view
from ..inputs.numbers import as_plain, parse_numbers
from ..pose.options import SearchMethod
from .options import Kind, choice, integer, keywords, number, numbers, option, path, read_path, write_numbers

Sides: TypeAlias = tuple[float, float, float, float]
LEAST_CONFIDENCE = 0.3
FROM_FILE, UNKNOWN = "exif", "unknown"  # focal lengths


def _as_focal(name: str, focal: Any) -> Any:
    if isinstance(focal, str) and focal.lower().endswith("mm"):
        raise ValueError(
            f"{name} must be in pixels, got {focal!r}: multiply by the photograph's diagonal, in pixels, over the "
            "sensor's, which is 43.3mm if the lens is named by its equivalent for 35mm film"
        )
    focal = as_plain(focal)
    if focal not in (FROM_FILE, UNKNOWN):
        as_focal(name, focal)
    return float(focal) if isinstance(focal, int) else focal


def _write_focal(focal: Any) -> str:
    return focal if isinstance(focal, str) else f"{focal:g}" if isinstance(focal, float) else json.dumps(focal)


def _as_intrinsics(name: str, intrinsics: Any) -> Any:
    return intrinsics if isinstance(intrinsics, str) else as_intrinsics(name, intrinsics)


def _parse_intrinsics(text: str) -> Any:
    """Numbers, or the name of a file."""
    return parse_numbers(read_path(text))


def _first(boxes: list[Sides]) -> Sides | None:
    """The box of the first object; the command makes a request for each."""
    return boxes[0] if boxes else None


AXIS = choice([f"{sign}{axis}" for sign in ("", "+", "-") for axis in "xyz"], "AXIS")
BOX = replace(numbers("x0,y0,x1,y1"), collect=_first)
FOCAL = Kind("PIXELS", _as_focal, parse_numbers, _write_focal)
POINT = numbers("x,y")
DISTORTION = numbers("k1,k2,p1,p2[,k3]", as_distortion)
CAMERA_NUMBERS = numbers("fx,fy,cx,cy", as_intrinsics)
INTRINSICS = Kind(
    "FILE_or_fx,fy,cx,cy",
    _as_intrinsics,
    _parse_intrinsics,
    lambda value: value if isinstance(value, str) else write_numbers(value),
)


@dataclass(frozen=True, kw_only=True)
class PoseRequest:
    """The pose of the object in a box of a photograph."""

    mesh: str | None = option(
        None,
        "a CAD model (OFF, PLY, STL, OBJ, GLB, glTF), or a folder of them (default: nablahog.sample_chairs)",
        path("FILE_or_DIR"),
    )
    up: str | None = option(
        None, "the axis of the models that points up, such as --up=-z (default: y for OBJ, GLB and glTF, else z)", AXIS
    )
    front: str | None = option(None, "the axis that their front faces (default: -y if z is up, +z if y is up)", AXIS)
    box: Sides | None = option(
        None,
        "a rough box around each object, in pixels; repeatable (default: search everywhere)",
        BOX,
        keyword=True,
        on_page=True,
    )
    mask: str | None = option(None, "an image, white where the object is, black elsewhere", path("FILE"))
    annotations: str | None = option(
        None,
        "list of objects: .csv with image and, if known, x0, y0, x1, y1, azimuth, elevation; or .json like COCO's",
        path("FILE"),
    )
    initial: tuple[float, float] | None = option(
        None,
        "initial azimuth and elevation, roughly, if known, such as --init=-30,10",
        numbers("az,el", as_view),
        flag="--init",
        keyword=True,
        on_page=True,
    )
    within: float = option(
        180.0,
        "most degrees of azimuth from --init",
        number("DEGREES", most=180, above=0),
        keyword=True,
    )
    focal: Any = option(
        None,
        "focal length in pixels, exif to read it from the file, or unknown (default: exif if the file has it)",
        FOCAL,
        keyword=True,
        on_page=True,
    )
    principal_point: tuple[float, float] | None = option(
        None, "where the optical axis is, in pixels (default: middle)", POINT, keyword=True, on_page=True
    )
    intrinsics: Any = option(
        None,
        "the camera, in pixels, or its file: COLMAP's cameras.txt, or JSON such as OpenCV's and ROS's",
        INTRINSICS,
        keyword=True,
    )
    distortion: tuple[float, ...] | None = option(
        None,
        "OpenCV's coefficients of the lens, such as --distortion=-0.3,0.1,0,0",
        DISTORTION,
        keyword=True,
        on_page=True,
    )
    method: SearchMethod = option(
        "best", f"how to search: {', '.join(get_args(SearchMethod))}", keyword=True, on_page=True
    )
    least_confidence: float = option(
        LEAST_CONFIDENCE,
        "exit with status 4 if the rotation is less likely than P to be within 15 degrees",
        number("P", least=0, most=1),
    )
    seed: int = option(0, "seed of the random samples of method best", integer(0), keyword=True, on_page=True)
    page: bool = option(False, "write a page of pictures for each object, too")

    def keywords(self) -> dict[str, Any]:
        """The keywords of :func:`nablahog.estimate_pose` that ask for the same."""
        return keywords(self, PoseRequest)
