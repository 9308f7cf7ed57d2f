"""Errors of viewpoints.

The criteria for azimuths are those of the code published with PASCAL3D+, the error of rotations that of Tulsiani and
Malik.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..inputs.arrays import as_array
from ..inputs.numbers import as_integer

VIEW_COUNTS = (4, 8, 16, 24)  # how many equal sectors the azimuth is divided into, for the columns of Table 2
MOST_VIEWS = 2**16


def azimuth_error(estimate: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Angle between two azimuths.

    Args:
        estimate, truth: degrees, finite, of shapes that broadcast; multiples of 360° make no difference.

    Returns:
        Degrees in 0…180.

    Raises:
        TypeError: an azimuth is no real number.
        ValueError: an azimuth is NaN or infinite, or the shapes do not broadcast.

    >>> nablahog.metrics.azimuth_error([350, 90], 10).tolist()
    [20.0, 80.0]
    """
    first, second = _read_pair(estimate, truth)
    difference = np.mod(first - second, 360)
    error: NDArray[np.float64] = np.minimum(difference, 360 - difference)
    return error


def view(azimuth: ArrayLike, views: int) -> NDArray[np.int64]:
    """The view of an azimuth: one of ``views`` equal intervals, of which the first has 0° in its middle.

    An edge belongs to the interval above it, except the last one, 360° - 180°/views, which belongs to the interval
    below, as in the published code.

    Args:
        azimuth: degrees, finite, of any shape.
        views: 1 … 65,536.

    Returns:
        0…views - 1, of the same shape.

    Raises:
        TypeError: an azimuth is no real number.
        ValueError: an azimuth is NaN or infinite, or ``views`` is no such integer.

    >>> nablahog.metrics.view([0, 44, 46, 350], views=4).tolist()
    [0, 0, 1, 0]
    """
    views = _read_views(views)
    edges = (np.arange(views) + 0.5) * (360 / views)
    turned = np.mod(_read_angles(azimuth), 360)
    return np.where(turned > edges[-1], 0, np.searchsorted(edges[:-1], turned, side="right"))


def same_view(estimate: ArrayLike, truth: ArrayLike, views: int) -> NDArray[np.bool_]:
    """The interval criterion: whether two azimuths, in degrees, are in the same :func:`view`.

    Args:
        estimate, truth: degrees, of shapes that broadcast.
        views: number of views around the object; view 0 has 0° in its middle.

    Returns:
        One truth value for each pair.

    >>> nablahog.metrics.same_view([10, 350], 20, views=8).tolist()  # view 0 is -22.5…22.5
    [True, True]
    """
    first, second = _read_pair(estimate, truth)
    return np.equal(view(first, views), view(second, views))


def near_view(estimate: ArrayLike, truth: ArrayLike, views: int) -> NDArray[np.bool_]:
    """The threshold criterion: whether two azimuths, in degrees, are less than 360°/views apart.

    For 4, 8, 16 and 24 views, that is 90°, 45°, 22.5° and 15°.

    Args:
        estimate, truth: degrees, of shapes that broadcast.
        views: number of views around the object.

    Returns:
        One truth value for each pair.

    >>> nablahog.metrics.near_view([10, 350], 40, views=8).tolist()  # less than 45° apart
    [True, False]
    """
    return np.less(azimuth_error(estimate, truth), 360 / _read_views(views))


def rotation_error(estimate: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Geodesic distance of two viewpoints: the angle of the rotation R_estimate · R_truthᵀ, and so of one to the other.

    It is ‖log(R_estimate · R_truthᵀ)‖_F / √2.  Poses of rigid objects are reported by its median, and by the share of
    objects within π/6 (30°) and π/18 (10°).

    Args:
        estimate, truth: (…, 3) azimuth, elevation and in-plane rotation theta, degrees, finite, of shapes that
            broadcast; as in :data:`nablahog.render.PARAMETERS`.

    Returns:
        Degrees in 0…180, (…).

    Raises:
        TypeError: an angle is no real number.
        ValueError: the last axis is not of length 3, an angle is NaN or infinite, or the shapes do not broadcast.

    Source: Tulsiani and Malik, Viewpoints and Keypoints (CVPR 2015), Section 4.2.

    >>> nablahog.metrics.rotation_error([[30, 0, 0], [10, 20, 0], [10, 0, 50]], [10, 0, 0]).round(6).tolist()
    [20.0, 20.0, 50.0]
    >>> near_the_pole = [90, 80, 0], [0, 80, 0]  # where the image turns by the difference of the azimuths
    >>> round(float(nablahog.metrics.rotation_error(*near_the_pole)), 6)
    90.0
    """
    first, second = map(_rotations, _read_pair(estimate, truth))
    # a unit vector turned by an angle α about the axis of the rotation: sin α from R − Rᵀ, cos α from the trace
    turn = first @ np.swapaxes(second, -1, -2)
    skew = turn - np.swapaxes(turn, -1, -2)
    sine = np.sqrt(skew[..., 0, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 2] ** 2) / 2
    cosine = (np.trace(turn, axis1=-2, axis2=-1) - 1) / 2
    error: NDArray[np.float64] = np.degrees(np.arctan2(sine, cosine))
    return error


def _rotations(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the object's frame to the camera's, (…, 3, 3): its rows are the camera's axes right, down and forward."""
    if degrees.shape[-1:] != (3,):
        raise ValueError(f"expected azimuth, elevation and theta along the last axis, got shape {degrees.shape}")
    azimuth, elevation, theta = np.moveaxis(np.radians(degrees), -1, 0)
    sa, ca, se, ce = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
    st, ct = np.sin(theta)[..., None], np.cos(theta)[..., None]
    right = np.stack([ca, sa, np.zeros_like(sa)], axis=-1)
    down = np.stack([se * sa, -se * ca, -ce], axis=-1)
    forward = np.stack([-ce * sa, ce * ca, -se], axis=-1)
    return np.stack([ct * right + st * down, ct * down - st * right, forward], axis=-2)


def _read_pair(estimate: ArrayLike, truth: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles of shapes that broadcast."""
    first, second = _read_angles(estimate), _read_angles(truth)
    try:
        np.broadcast_shapes(first.shape, second.shape)
    except ValueError:
        raise ValueError(
            f"expected as many true angles as estimated ones, or one for all, got shapes {first.shape} and "
            f"{second.shape}"
        ) from None
    return first, second


def _read_angles(angle: ArrayLike) -> NDArray[np.float64]:
    values = as_array("an angle in degrees", angle)
    if values.dtype.kind == "b":
        raise TypeError("expected angles in degrees, numbers or arrays of them, got truth values")
    if not np.isfinite(values).all():
        raise ValueError("expected angles in degrees, got NaN or infinity")
    return values.astype(np.float64)


def _read_views(views: int) -> int:
    return as_integer("views", views, 1, MOST_VIEWS)
