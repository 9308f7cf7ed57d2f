"""Similarity of two images (CC, MI, SSIM, PSNR), and errors of viewpoints.

The paper names CC, MI and SSIM but does not define them; the definitions here are ours, and :data:`DEFINITIONS` is
printed with every table.  The criteria for azimuths are those of the code published with PASCAL3D+, the error of
rotations that of Tulsiani and Malik.

Images are NumPy arrays, tensors on any device, or nested lists, (H, W), in 0…1 or uint8 in 0…255.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d

__all__ = [
    "azimuth_error",
    "cross_correlation",
    "mutual_information",
    "near_view",
    "psnr",
    "rotation_error",
    "same_view",
    "ssim",
    "view",
]

Image: TypeAlias = Tensor | ArrayLike
GRAY_BINS = 256
SSIM_WINDOW, K1, K2 = 7, 0.01, 0.03  # of SSIM
VIEW_COUNTS = (4, 8, 16, 24)  # how many equal sectors the azimuth is divided into, for the columns of Table 2

DEFINITIONS = {
    "CC": "Pearson correlation over all pixels of the gray reference (Eq. 1) and the pre-image, 0 if either is "
    "constant; its sign says little for descriptors of unsigned gradients, which are those of the negative, too.",
    "MI": f"Mutual information in bits, from the joint histogram of all pixels in {GRAY_BINS}x{GRAY_BINS} equal bins "
    "over 0…1; not corrected for its bias, so compare it between images of one size only.",
    "SSIM": "Mean structural similarity as in scikit-image, data range 1: 7x7 uniform window, sample covariances; none "
    "for images narrower than 7 pixels.",
    "PSNR": "Peak signal-to-noise ratio in dB, −10 log10 of the mean squared error, peak 1; none for equal images.",
    "distance": "‖φ(x) − d‖ / ‖d‖, d the given descriptor and φ(x) that of the pre-image x before it is rounded to 8 "
    "bits.",
}
"""A sentence for each measure."""


def _read_pair(a: Image, b: Image) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if np.ma.is_masked(a) or np.ma.is_masked(b):
        raise ValueError("expected images without masked pixels, got an array that masks some")
    first, second = _read_values(a), _read_values(b)
    if first.shape != second.shape or first.ndim != 2 or first.size == 0:
        hint = ": write image[0, 0] for each image of a batch" if 4 in (first.ndim, second.ndim) else ""
        raise ValueError(f"expected two images of one shape (H, W), got {first.shape} and {second.shape}{hint}")
    return _clip(first), _clip(second)


def _clip(image: NDArray[np.float64]) -> NDArray[np.float64]:
    # float32 sums of the gray weights may pass 1 by a rounding
    if not (image.min() >= -1e-6 and image.max() <= 1 + 1e-6):
        raise ValueError(f"expected images in 0…1, got values in {image.min():g} … {image.max():g}")
    return image.clip(0, 1)


def _read_values(image: Image) -> NDArray[np.float64]:
    values = image.detach().cpu().numpy() if isinstance(image, Tensor) else np.asarray(image)
    return values / 255.0 if values.dtype == np.uint8 else values.astype(np.float64)


def cross_correlation(a: Image, b: Image) -> float:
    """CC: Pearson correlation of the pixels of two images.

    Args:
        a, b: (H, W), in 0…1 or uint8.

    Returns:
        In -1…1; 0.0 where it is undefined, that is where ``a`` or ``b`` is constant.

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.

    >>> image = [[0.0, 0.5], [0.25, 1.0]]
    >>> negative = [[1.0, 0.5], [0.75, 0.0]]
    >>> [round(nablahog.metrics.cross_correlation(image, other), 6) for other in (image, negative)]
    [1.0, -1.0]
    """
    first, second = _read_pair(a, b)
    if np.ptp(first) == 0 or np.ptp(second) == 0:  # differences from a rounded mean would be noise, not 0
        return 0.0
    first, second = first - first.mean(), second - second.mean()
    norms = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.clip((first * second).sum() / norms, -1, 1)) if norms > 0 else 0.0


def mutual_information(a: Image, b: Image, bins: int = GRAY_BINS) -> float:
    """MI: mutual information H(a) + H(b) - H(a, b) of the pixels of two images, in bits (logarithms to base 2).

    Entropies are those of the joint histogram over 0…1 with ``bins`` x ``bins`` equal bins; 256 give each 8-bit level
    a bin of its own.  The estimate is not corrected for its bias of up to about (bins - 1)² / (2 ln 2 · pixels) bits.

    Args:
        a, b: (H, W), in 0…1 or uint8.
        bins: number of bins for each image, at least 1.

    Returns:
        In 0…log2(bins).

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.

    >>> image = [[0.1, 0.4, 0.6, 0.9]]  # four levels: two bits
    >>> nablahog.metrics.mutual_information(image, image)
    2.0
    >>> nablahog.metrics.mutual_information(image, image, bins=2)
    1.0
    """
    first, second = _read_pair(a, b)
    joint, _, _ = np.histogram2d(first.ravel(), second.ravel(), bins=bins, range=((0, 1), (0, 1)))
    shares = (counts[counts > 0] / counts.sum() for counts in (joint.sum(1), joint.sum(0), joint))
    entropy_a, entropy_b, entropy_ab = (float(-(p * np.log2(p)).sum()) for p in shares)
    return max(0.0, entropy_a + entropy_b - entropy_ab)


def ssim(a: Image, b: Image) -> float:
    """SSIM: mean structural similarity of two images.

    As ``skimage.metrics.structural_similarity(a, b, data_range=1)`` computes it: a uniform window of 7x7 pixels, sample
    covariances, K1 = 0.01, K2 = 0.03, and the mean over all windows inside the image.

    Args:
        a, b: (H, W), in 0…1 or uint8.

    Returns:
        At most 1; NaN for images with a side below 7 pixels.

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.

    Source: Wang et al., Image Quality Assessment: From Error Visibility to Structural Similarity (TIP 2004).

    >>> import torch
    >>> image = torch.linspace(0, 1, 64).reshape(8, 8)
    >>> nablahog.metrics.ssim(image, image)
    1.0
    """
    first, second = _read_pair(a, b)
    if min(first.shape) < SSIM_WINDOW:
        return float("nan")
    x, y = (torch.from_numpy(image)[None, None] for image in (first, second))
    mean_x, mean_y = _window_means(x), _window_means(y)
    unbiased = SSIM_WINDOW**2 / (SSIM_WINDOW**2 - 1)
    variances = unbiased * (_window_means(x * x) - mean_x**2 + _window_means(y * y) - mean_y**2)
    covariance = unbiased * (_window_means(x * y) - mean_x * mean_y)
    brightness = (2 * mean_x * mean_y + K1**2) / (mean_x**2 + mean_y**2 + K1**2)
    similarity = brightness * (2 * covariance + K2**2) / (variances + K2**2)  # Eq. 13 there, for data in 0…1
    return float(similarity.mean())


def _window_means(image: Tensor) -> Tensor:
    """The mean of each window inside an image (1, 1, H, W)."""
    return avg_pool2d(image, SSIM_WINDOW, stride=1)


def psnr(a: Image, b: Image) -> float:
    """PSNR: peak signal-to-noise ratio of two images in dB, -10 log10 of their mean squared error, peak 1.

    Args:
        a, b: (H, W), in 0…1 or uint8.

    Returns:
        At least 0; infinity for equal images.

    Raises:
        ValueError: the shapes differ or are not (H, W), or a value is not in 0…1.

    >>> image = [[0.0, 0.5], [0.5, 0.9]]
    >>> round(nablahog.metrics.psnr(image, [[0.1, 0.6], [0.4, 1.0]]), 6)  # a mean squared error of 0.01
    20.0
    >>> nablahog.metrics.psnr(image, image)
    inf
    """
    first, second = _read_pair(a, b)
    error = float(np.square(first - second).mean())
    return 10 * math.log10(1 / error) if error > 0 else math.inf


MEASURES = {"CC": cross_correlation, "MI": mutual_information, "SSIM": ssim, "PSNR": psnr}
"""Measures of an image and its reference, by the names of :data:`DEFINITIONS`."""


def azimuth_error(estimate: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Angle between two azimuths.

    Args:
        estimate, truth: degrees, finite, of shapes that broadcast; multiples of 360° make no difference.

    Returns:
        Degrees in 0…180.

    Raises:
        ValueError: an azimuth is NaN or infinite.

    >>> nablahog.metrics.azimuth_error([350, 90], 10).tolist()
    [20.0, 80.0]
    """
    difference = np.mod(_read_angles(estimate) - _read_angles(truth), 360)
    error: NDArray[np.float64] = np.minimum(difference, 360 - difference)
    return error


def view(azimuth: ArrayLike, views: int) -> NDArray[np.int64]:
    """The view of an azimuth: one of ``views`` equal intervals, of which the first has 0° in its middle.

    An edge belongs to the interval above it, except the last one, 360° - 180°/views, which belongs to the interval
    below, as in the published code.

    Args:
        azimuth: degrees, finite, of any shape.
        views: at least 1.

    Returns:
        0…views - 1, of the same shape.

    Raises:
        ValueError: an azimuth is NaN or infinite.

    >>> nablahog.metrics.view([0, 44, 46, 350], views=4).tolist()
    [0, 0, 1, 0]
    """
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
    return np.equal(view(estimate, views), view(truth, views))


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
    return np.less(azimuth_error(estimate, truth), 360 / views)


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
        ValueError: the last axis is not of length 3, or an angle is NaN or infinite.

    Source: Tulsiani and Malik, Viewpoints and Keypoints (CVPR 2015), Section 4.2.

    >>> nablahog.metrics.rotation_error([[30, 0, 0], [10, 20, 0], [10, 0, 50]], [10, 0, 0]).round(6).tolist()
    [20.0, 20.0, 50.0]
    >>> near_the_pole = [90, 80, 0], [0, 80, 0]  # where the image turns by the difference of the azimuths
    >>> round(float(nablahog.metrics.rotation_error(*near_the_pole)), 6)
    90.0
    """
    first, second = _rotations(estimate), _rotations(truth)
    # a unit vector turned by an angle α about the axis of the rotation: sin α from R − Rᵀ, cos α from the trace
    turn = first @ np.swapaxes(second, -1, -2)
    skew = turn - np.swapaxes(turn, -1, -2)
    sine = np.sqrt(skew[..., 0, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 2] ** 2) / 2
    cosine = (np.trace(turn, axis1=-2, axis2=-1) - 1) / 2
    error: NDArray[np.float64] = np.degrees(np.arctan2(sine, cosine))
    return error


def _rotations(angles: ArrayLike) -> NDArray[np.float64]:
    """From the object's frame to the camera's, (…, 3, 3): its rows are the camera's axes right, down and forward."""
    degrees = _read_angles(angles)
    if degrees.shape[-1:] != (3,):
        raise ValueError(f"expected azimuth, elevation and theta along the last axis, got shape {degrees.shape}")
    azimuth, elevation, theta = np.moveaxis(np.radians(degrees), -1, 0)
    sa, ca, se, ce = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
    st, ct = np.sin(theta)[..., None], np.cos(theta)[..., None]
    right = np.stack([ca, sa, np.zeros_like(sa)], axis=-1)
    down = np.stack([se * sa, -se * ca, -ce], axis=-1)
    forward = np.stack([-ce * sa, ce * ca, -se], axis=-1)
    return np.stack([ct * right + st * down, ct * down - st * right, forward], axis=-2)


def _read_angles(angle: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(angle, dtype=np.float64)
    if not np.isfinite(values).all():
        raise ValueError("expected angles in degrees, got NaN or infinity")
    return values


def __dir__() -> list[str]:
    return __all__
