"""The camera that took a photograph: focal lengths, principal point and distortion, as people have them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .numbers import as_number, as_numbers, as_plain, is_finite, shortened

SHORTEST, LONGEST = 0.1, 100.0
"""Focal lengths of real lenses, in diagonals of the photograph."""
OFF_MIDDLE = 0.2
"""Share of a side's half by which the principal point of a photograph that was not cut is never off the middle."""
FAR_OFF_MIDDLE = 0.6
"""The same share, above which a principal point is more likely of another photograph."""
SAME_SCALE = 0.05  # at most, between both sides, if the intrinsics are of another size
MOST_UNEQUAL = 2.5  # times the smaller focal length; an anamorphic lens has 2
ROUNDING = 1e-9  # of the numbers of a camera matrix that are 0 or 1
_COEFFICIENTS = "k1, k2, p1, p2, k3"


@dataclass(frozen=True)
class PhotographCamera:
    """The camera that took a photograph, in the photograph's pixels, whose upper left corner is (0, 0).

    Attributes:
        height, width: of the photograph.
        fx, fy: focal lengths along x and y, above 0.
        cx, cy: the principal point.
        distortion: k1, k2, p1, p2, k3 of OpenCV's formula; all 0 for none.
    """

    height: int
    width: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0,) * 5

    @property
    def is_ideal(self) -> bool:
        """Whether its pixels are square, and it distorts nothing."""
        return self.fx == self.fy and not any(self.distortion)

    @property
    def matrix(self) -> list[list[float]]:
        """The camera matrix (3, 3)."""
        return [[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]]


def as_view(name: str, view: object) -> tuple[float, float]:
    """Azimuth and elevation, degrees; the elevation is in -90…90."""
    azimuth, elevation = as_numbers(name, view, "azimuth, elevation")
    return azimuth, as_number(f"the elevation of {name}", elevation, -90, 90)


def as_camera(
    height: int,
    width: int,
    focal: object = None,
    principal_point: object = None,
    intrinsics: object = None,
    distortion: object = None,
) -> PhotographCamera | None:
    """The camera of a photograph of ``height`` x ``width`` pixels; None if its focal length is not known.

    Args:
        focal: as :func:`as_focal` takes it; None if unknown, or if there are intrinsics.
        principal_point: x, y in pixels; None for that of a camera matrix, or the middle.
        intrinsics: as :func:`as_intrinsics` takes them; None for none.
        distortion: as :func:`as_distortion` takes it; None for none.

    Raises:
        ValueError: they are none of these, contradict each other, or belong to a photograph of another size; or the
            principal point is not in pixels.
    """
    coefficients = (0.0,) * 5 if distortion is None else as_distortion("distortion", distortion)
    point = None if principal_point is None else as_numbers("principal_point", principal_point, "x, y")
    if intrinsics is not None:
        if focal is not None or point is not None:
            raise ValueError(
                "`intrinsics` has focal length and principal point: leave `focal` and `principal_point` out"
            )
        fx, fy, *own = as_intrinsics("intrinsics", intrinsics)
    elif focal is not None:
        fx, fy, *own = as_focal("focal", focal)
        if own and point is not None and point != tuple(own):
            raise ValueError(f"`principal_point` is {point}, but the camera matrix has {tuple(own)}: leave it out")
    elif point is not None or distortion is not None:
        name = "distortion" if point is None else "principal_point"
        raise ValueError(f"`{name}` needs a known focal length: give `focal` or `intrinsics`, too")
    else:
        return None
    cx, cy = own or point or (width / 2, height / 2)
    diagonal = math.hypot(height, width)
    if not SHORTEST * diagonal <= min(fx, fy) <= max(fx, fy) <= LONGEST * diagonal:
        raise ValueError(
            f"`{'focal' if intrinsics is None else 'intrinsics'}` must be in pixels, {SHORTEST:g} to {LONGEST:g} "
            f"diagonals of the photograph, got {_write_pair(fx, fy)} for {height}x{width} pixels; convert millimetres "
            f"by the factor {diagonal:.0f} / diagonal of the sensor in millimetres, 43.3 if the lens is named by its "
            "equivalent for 35mm film"
        )
    if 0 <= cx <= 1 < width and 0 <= cy <= 1 < height:
        raise ValueError(
            f"the principal point must be in pixels from the upper left corner, got {(cx, cy)}: write (x * width, "
            "y * height) of parts of the sides, or leave it out if it is not known"
        )
    if math.hypot(cx - width / 2, cy - height / 2) > LONGEST * diagonal:
        raise ValueError(
            f"the principal point must be within {LONGEST:g} diagonals of the photograph, got {(cx, cy)} for "
            f"{height}x{width} pixels: it is in pixels"
        )
    return PhotographCamera(height, width, fx, fy, cx, cy, coefficients)


def advise_on_size(height: int, width: int, cx: float, cy: float) -> str | None:
    """A sentence if the principal point is the middle of a photograph of another size, as before it was resized.

    Or if it is so far off the middle of this one as only a photograph that was cut has it, or outside.
    """
    across, down = 2 * cx / width, 2 * cy / height
    off_middle = max(abs(across - 1), abs(down - 1))
    other, size = f"{2 * cy:.0f}x{2 * cx:.0f} pixels (height x width)", f"{height}x{width}"
    place, write = (
        f"the middle of a photograph of about {other}, not of {size}",
        "give the intrinsics of this photograph",
    )
    if abs(across - 1) >= OFF_MIDDLE and abs(across - down) <= SAME_SCALE * max(across, down):
        write = f"multiply all intrinsics by {1 / across:.3g}"
    elif off_middle > 1:
        place = f"outside the photograph of {size} pixels (height x width)"
    elif off_middle > FAR_OFF_MIDDLE:
        write += ", as it is turned"
    else:
        return None
    return f"the principal point {cx:g}, {cy:g} is {place}: unless this one was cut, {write}"


def as_focal(name: str, focal: object) -> tuple[float, ...]:
    """The focal lengths fx, fy in pixels; and the principal point cx, cy, if it is a camera matrix.

    Args:
        name: of the argument.
        focal: the focal length; (fx, fy); or the camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].  Numbers, lists,
            arrays or tensors.

    Raises:
        ValueError: it is no such numbers, or the matrix has skew.
    """
    plain = as_plain(focal)
    if is_finite(plain):
        plain = (plain, plain)
    elif _is_matrix(plain):
        return as_intrinsics(name, focal)
    expected = "a finite number of pixels above 0, (fx, fy), a camera matrix (3, 3), or 'exif'"
    if not isinstance(plain, tuple) or len(plain) != 2:
        raise ValueError(f"{name} must be {expected}, got {shortened(focal)}")
    return _check_focal(name, focal, plain, expected)


def as_intrinsics(name: str, intrinsics: object) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy in pixels.

    Args:
        name: of the argument.
        intrinsics: these four; or the camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].  Numbers, lists, arrays or
            tensors.

    Raises:
        ValueError: they are no such numbers, or the matrix has skew.
    """
    plain = as_plain(intrinsics)
    if _is_matrix(plain):
        (fx, skew, cx), (zero, fy, cy), (first, second, last) = plain
        if max(map(abs, (skew, zero, first, second, last - 1))) > ROUNDING:
            raise ValueError(
                f"a camera matrix as {name} must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "
                f"got {shortened([list(row) for row in plain])}"
            )
        plain = (fx, fy, cx, cy)
    expected = "a camera matrix (3, 3), or fx, fy, cx, cy in pixels with focal lengths above 0"
    if not isinstance(plain, tuple) or len(plain) != 4 or not all(map(is_finite, plain)):
        write = ": write np.reshape(K, (3, 3))" if isinstance(plain, tuple) and len(plain) == 9 else ""  # of ROS
        raise ValueError(f"{name} must be {expected}, got {shortened(intrinsics)}{write}")
    fx, fy = _check_focal(name, intrinsics, plain[:2], expected)
    return fx, fy, float(plain[2]), float(plain[3])


def as_distortion(name: str, distortion: object) -> tuple[float, float, float, float, float]:
    """OpenCV's coefficients k1, k2, p1, p2, k3 of 4 or 5 numbers, or more of which all others are 0.

    Raises:
        ValueError: they are none, or those of another model.
    """
    plain = as_plain(distortion)
    if isinstance(plain, tuple) and plain and all(isinstance(row, tuple) for row in plain):
        plain = tuple(number for row in plain for number in row)  # OpenCV returns (1, 5) or (5, 1)
    if not isinstance(plain, tuple) or len(plain) < 4 or not all(map(is_finite, plain)):
        raise ValueError(
            f"{name} must be OpenCV's {_COEFFICIENTS}, of which k3 may be left out, got {shortened(distortion)}: "
            "write 0 for those that are not used"
        )
    if any(plain[5:]):
        raise ValueError(
            f"{name} must be OpenCV's {_COEFFICIENTS}, got a model of {len(plain)} numbers: undistort the photograph "
            "with cv2.undistort, and leave the distortion out"
        )
    k1, k2, p1, p2, k3 = (*map(float, plain), 0.0)[:5]
    return k1, k2, p1, p2, k3


def _check_focal(name: str, given: object, pair: tuple[Any, ...], expected: str) -> tuple[float, float]:
    if not all(is_finite(side) and side > 0 for side in pair):
        raise ValueError(f"{name} must be {expected}, got {shortened(given)}")
    fx, fy = map(float, pair)
    if max(fx, fy) > MOST_UNEQUAL * min(fx, fy):
        raise ValueError(
            f"{name} must have focal lengths fx and fy of which none is more than {MOST_UNEQUAL:g} times the other, "
            f"got {fx:g} and {fy:g}"
        )
    return fx, fy


def _write_pair(fx: float, fy: float) -> str:
    return f"{fx:g}" if fx == fy else f"{fx:g} and {fy:g}"


def _is_matrix(value: object) -> bool:
    return (
        isinstance(value, tuple)
        and len(value) == 3
        and all(isinstance(row, tuple) and len(row) == 3 and all(map(is_finite, row)) for row in value)
    )
