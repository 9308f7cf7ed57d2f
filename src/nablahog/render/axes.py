"""The axes of CAD models, whose files do not say which way is up."""

from __future__ import annotations

import re
from typing import TypeAlias

Vector: TypeAlias = tuple[int, int, int]

FRONTS = {"z": "-y", "y": "+z"}
"""The axis that the front of CAD models usually looks along, by the axis that points up."""


def axes(up: str, front: str | None = None) -> tuple[Vector, Vector, Vector]:
    """The rotation from a file's frame to the object's, z up and front to -y, row by row.

    Args:
        up: the axis of the file that points up: x, y or z, with a sign or without.
        front: the axis that the front looks along; None for that of :data:`FRONTS`.

    Raises:
        ValueError: there is no such axis, none is usual for ``up``, or the two are along one line.

    >>> from nablahog.render.axes import axes
    >>> axes("y", "+z")
    ((1, 0, 0), (0, 0, -1), (0, 1, 0))
    """
    upwards = _axis("up", up)
    front = FRONTS.get(up.lstrip("+")) if front is None else front
    if front is None:
        raise ValueError(f"a model whose up is {up!r} has no usual front: expected front, too, such as '-y'")
    ahead = _axis("front", front)
    if ahead in (upwards, _negative(upwards)):
        raise ValueError(f"up and front must be two axes, got {up!r} and {front!r}")
    return _cross(upwards, ahead), _negative(ahead), upwards


def _axis(name: str, text: str) -> Vector:
    match = re.fullmatch(r"([+-]?)([xyz])", text)
    if match is None:
        raise ValueError(f"{name} must be one of x, y and z, with a sign or without, got {text!r}")
    sign = -1 if match[1] == "-" else 1
    x, y, z = (sign * (axis == match[2]) for axis in "xyz")
    return x, y, z


def _negative(a: Vector) -> Vector:
    return -a[0], -a[1], -a[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
