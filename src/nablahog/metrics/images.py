"""Similarity of two images: CC, MI, SSIM, PSNR.

The paper names CC, MI and SSIM but does not define them; the definitions here are ours, and :data:`DEFINITIONS` is
printed with every table.

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

from ..inputs.arrays import AS_GRAY, as_gray
from ..inputs.numbers import as_integer

Image: TypeAlias = Tensor | ArrayLike
GRAY_BINS, MOST_BINS = 256, 4096
SSIM_WINDOW, K1, K2 = 7, 0.01, 0.03  # of SSIM
_ADVICE = {3: AS_GRAY, 4: "image[0, 0] for each image of a batch"}  # what to write, by the number of axes

DEFINITIONS = {
    "CC": "Pearson correlation over all pixels of the gray reference (Eq. 1) and the pre-image, 0 if either is "
    "constant; for descriptors of unsigned gradients, which are those of the negative, too, its sign says little, and "
    "it is near 0 if some regions are right and others negatives.",
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
    first, second = as_gray("the first image", a), as_gray("the second image", b)
    if first.shape != second.shape or first.ndim != 2 or first.size == 0:
        axes = max(first.ndim, second.ndim)
        hint = f": write {_ADVICE[axes]}" if axes in _ADVICE else ""
        raise ValueError(f"expected two images of one shape (H, W), got {first.shape} and {second.shape}{hint}")
    return _clip(first), _clip(second)


def _clip(image: NDArray[np.float64]) -> NDArray[np.float64]:
    # float32 sums of the gray weights may pass 1 by a rounding
    if not (image.min() >= -1e-6 and image.max() <= 1 + 1e-6):
        raise ValueError(f"expected images in 0…1, got values in {image.min():g} … {image.max():g}")
    return image.clip(0, 1)


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
        bins: number of bins for each image, 1…4096.

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
    bins = as_integer("bins", bins, most=MOST_BINS)
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
