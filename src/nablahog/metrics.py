"""How alike two pictures, and two viewpoints, are, as the figures of this package state it.

The paper names the three measures of pictures but not their definitions; these are ours, and :data:`DEFINITIONS` is
printed with every table of them.  Viewpoints are counted as in the code published with PASCAL3D+.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .io.images import Picture, as_array

BINS = 256
VIEWS = (4, 8, 16, 24)
"""Into how many equal views the azimuth is divided, for the columns of Table 2."""

DEFINITIONS = {
    "CC": "Pearson correlation over all pixels of the gray reference (Eq. 1) and the pre-image, 0 if either is "
    "constant; its sign says little for descriptors of unsigned gradients, which are those of the negative, too.",
    "MI": f"Mutual information in bits, from the joint histogram of all pixels in {BINS}x{BINS} equal bins over 0…1; "
    "not corrected for its bias, so compare it between images of one size only.",
    "SSIM": "Mean structural similarity as in scikit-image, data range 1: 7x7 uniform window, sample covariances; none "
    "for images narrower than 7 pixels.",
    "distance": "‖φ(x) − d‖ / ‖d‖, d the given descriptor and φ(x) that of the pre-image x before it is rounded to 8 "
    "bits.",
}
"""One sentence for each figure."""


def _pair(a: Picture, b: Picture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, second = as_array(a), as_array(b)
    if first.shape != second.shape or first.ndim != 2 or first.size == 0:
        raise ValueError(f"expected two images of one shape (H, W), got {first.shape} and {second.shape}")
    for image in (first, second):
        # float32 sums of the gray weights may pass 1 by a rounding
        if not (image.min() >= -1e-6 and image.max() <= 1 + 1e-6):
            raise ValueError(f"expected images in 0…1, got values in {image.min():g} … {image.max():g}")
    return first.clip(0, 1), second.clip(0, 1)


def cross_correlation(a: Picture, b: Picture) -> float:
    """Pearson correlation of the pixels of two images, -1…1.

    Args:
        a, b: (H, W), arrays or tensors in 0…1.

    Returns:
        The correlation; 0.0 where it is undefined, that is where ``a`` or ``b`` is constant.

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.
    """
    first, second = _pair(a, b)
    if np.ptp(first) == 0 or np.ptp(second) == 0:  # differences from a rounded mean would be noise, not 0
        return 0.0
    first, second = first - first.mean(), second - second.mean()
    norms = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.clip((first * second).sum() / norms, -1, 1)) if norms > 0 else 0.0


def mutual_information(a: Picture, b: Picture, bins: int = BINS) -> float:
    """Mutual information H(a) + H(b) - H(a, b) of two images in bits, 0…log2(bins).

    From the joint histogram over 0…1 with ``bins`` equal bins a side; 256 give each 8-bit level its own.  The
    estimate is not corrected for its bias of up to about (bins - 1)² / (2 ln 2 · pixels) bits.

    Args:
        a, b: (H, W), arrays or tensors in 0…1.
        bins: at least 1.

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.
    """
    first, second = _pair(a, b)
    joint, _, _ = np.histogram2d(first.ravel(), second.ravel(), bins=bins, range=((0, 1), (0, 1)))
    entropy_a, entropy_b, entropy_ab = (_entropy(counts) for counts in (joint.sum(1), joint.sum(0), joint))
    return max(0.0, entropy_a + entropy_b - entropy_ab)


def _entropy(counts: NDArray[np.float64]) -> float:
    p = counts[counts > 0] / counts.sum()
    return float(-(p * np.log2(p)).sum())


def ssim(a: Picture, b: Picture) -> float:
    """Mean structural similarity of two images as ``skimage.metrics.structural_similarity(a, b, data_range=1)``.

    Args:
        a, b: (H, W), arrays or tensors in 0…1.

    Returns:
        At most 1; NaN for images with a side below 7 pixels, the width of the window.

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.
    """
    from skimage.metrics import structural_similarity  # slow to import, and most uses need none of it

    first, second = _pair(a, b)
    if min(first.shape) < 7:
        return float("nan")
    return float(structural_similarity(first, second, data_range=1.0))  # type: ignore[no-untyped-call]


def azimuth_error(found: ArrayLike, true: ArrayLike) -> NDArray[np.float64]:
    """How far two azimuths are apart, the shorter way round.

    Args:
        found, true: degrees, finite, of shapes that broadcast; 360° more or less make no difference.

    Returns:
        Degrees in 0…180.

    Raises:
        ValueError: an azimuth is NaN or infinite.
    """
    apart = np.mod(_finite(found) - _finite(true), 360)
    error: NDArray[np.float64] = np.minimum(apart, 360 - apart)
    return error


def view(azimuth: ArrayLike, views: int) -> NDArray[np.int64]:
    """Which of ``views`` equal intervals an azimuth is in: the first, 0, has 0° in its middle.

    An edge belongs to the interval above it, but the last one, 360° - 180°/views, to that below, as in the published
    code.

    Args:
        azimuth: degrees, finite, of any shape.
        views: at least 1.

    Returns:
        0…views - 1, of the same shape.

    Raises:
        ValueError: an azimuth is NaN or infinite.
    """
    edges = (np.arange(views) + 0.5) * (360 / views)
    turned = np.mod(_finite(azimuth), 360)
    return np.where(turned > edges[-1], 0, np.searchsorted(edges[:-1], turned, side="right"))


def same_view(found: ArrayLike, true: ArrayLike, views: int) -> NDArray[np.bool_]:
    """The interval criterion: whether two azimuths are in the same :func:`view`."""
    return np.equal(view(found, views), view(true, views))


def near_view(found: ArrayLike, true: ArrayLike, views: int) -> NDArray[np.bool_]:
    """The threshold criterion: whether two azimuths are less than 360°/views apart, for 4, 8, 16 and 24 views 90, 45,
    22.5 and 15°."""
    return np.less(azimuth_error(found, true), 360 / views)


def _finite(azimuth: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(azimuth, dtype=np.float64)
    if not np.isfinite(values).all():
        raise ValueError("expected azimuths in degrees, got NaN or infinity")
    return values
