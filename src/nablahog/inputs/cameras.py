"""The camera of a photograph: a focal length in pixels, one for each axis, or a camera matrix."""

from __future__ import annotations

from .numbers import as_number, as_numbers, as_plain, is_finite, shortened

SQUARE_PIXELS = 0.01  # relative difference of the two focal lengths of a camera whose pixels count as square


def as_view(name: str, view: object) -> tuple[float, float]:
    """Azimuth and elevation, degrees; the elevation is in -90…90."""
    azimuth, elevation = as_numbers(name, view, "azimuth, elevation")
    return azimuth, as_number(f"the elevation of {name}", elevation, -90, 90)


def as_focal(name: str, focal: object, principal_point: object = None) -> tuple[float, tuple[float, float] | None]:
    """The focal length and the principal point x, y, in pixels, of a camera with square pixels.

    Args:
        name: of the argument ``focal``.
        focal: the focal length; (fx, fy); or the camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], which has the
            principal point, too.  Numbers, lists, arrays or tensors.
        principal_point: x, y; None for that of the matrix, or unknown.

    Raises:
        ValueError: they are no such numbers, the pixels are not square, the matrix has skew, or the principal point is
            given twice and differs.
    """
    point: tuple[float, ...] | None = None
    if principal_point is not None:
        point = as_numbers("principal_point", principal_point, "x, y")
    plain = as_plain(focal)
    if is_finite(plain):
        plain = (plain, plain)
    elif _is_matrix(plain):
        (fx, skew, cx), (zero, fy, cy), last = plain
        if skew or zero or last != (0, 0, 1):
            raise ValueError(
                f"a camera matrix as {name} must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "
                f"got {shortened([list(row) for row in plain])}"
            )
        if point is not None and point != (cx, cy):
            raise ValueError(f"`principal_point` is {point}, but the camera matrix has {(cx, cy)}: leave it out")
        plain, point = (fx, fy), (float(cx), float(cy))
    if not isinstance(plain, tuple) or len(plain) != 2 or not all(is_finite(side) and side > 0 for side in plain):
        raise ValueError(
            f"{name} must be a finite number of pixels above 0, (fx, fy), a camera matrix (3, 3), or 'exif', "
            f"got {shortened(focal)}"
        )
    fx, fy = map(float, plain)
    if abs(fx - fy) > SQUARE_PIXELS * max(fx, fy):
        raise ValueError(
            f"{name} must be that of square pixels, got fx {fx:g} and fy {fy:g}: resize the photograph's height by "
            f"fx / fy, {fx / fy:g}"
        )
    return (fx + fy) / 2, None if point is None else (point[0], point[1])


def _is_matrix(value: object) -> bool:
    return (
        isinstance(value, tuple)
        and len(value) == 3
        and all(isinstance(row, tuple) and len(row) == 3 and all(map(is_finite, row)) for row in value)
    )
