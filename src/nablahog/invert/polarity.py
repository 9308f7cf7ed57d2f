"""Polarity: is an image with an unsigned descriptor, which its negative has, too, the photograph or the negative?

Light is not symmetric:

* a sensor saturates in bright areas: what is exactly flat is usually white, be it sky or paper;
* shading multiplies reflectance: contrasts are stronger in bright areas;
* small highlights stand out more than small shadows.

None is certain.  Each cue is a number that changes its sign with the image; their weighted sum decides.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from ..hog.orientation import magnitude

PATCH_PIXELS = 8  # pixels; an image smaller than that is one patch
# mean gradient magnitudes of a patch, images in 0…1: upper limits of flat patches, lower limit of textured ones
EXACTLY_FLAT_GRADIENT, FLAT_GRADIENT, TEXTURED_GRADIENT = 0.002, 0.006, 0.04
INVISIBLE_STD = 1e-4  # standard deviation of detail, in 0…1, below which there is none
LEAST_SHARE = 0.02  # of the patches: with fewer flat ones the cue is 0
CUE_WEIGHTS = (3.0, 2.0, 0.8, 0.5)  # of the cues, chosen on exact photographs


def looks_negative(image: Tensor) -> Tensor:
    """Which images (B, 1, H, W) in 0…1 are probably negatives, (B,)."""
    return brightness_cues(image) @ torch.tensor(CUE_WEIGHTS, dtype=image.dtype, device=image.device) < 0


def brightness_cues(image: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1 to cues (B, 4), positive for a photograph.

    Whether exactly flat patches are bright, whether flat patches are, whether strong texture is, and highlights.
    """
    height, width = image.shape[-2:]
    dx = pad(image[..., :, 2:] - image[..., :, :-2], (1, 1)) if width > 2 else torch.zeros_like(image)
    dy = pad(image[..., 2:, :] - image[..., :-2, :], (0, 0, 1, 1)) if height > 2 else torch.zeros_like(image)
    size = min(PATCH_PIXELS, height, width)
    strength, brightness = avg_pool2d(magnitude(dx, dy), size), avg_pool2d(image, size)
    textured = (strength > TEXTURED_GRADIENT).to(image)
    cues = (
        _flat_is_bright(strength < EXACTLY_FLAT_GRADIENT, brightness),
        _flat_is_bright(strength < FLAT_GRADIENT, brightness),
        _correlation(brightness, torch.log(strength + 1e-3), textured),
        _highlights(image),
    )
    return torch.stack(cues, dim=1)


def _flat_is_bright(flat: Tensor, brightness: Tensor) -> Tensor:
    """Correlation (B,) over patches of flatness with brightness; 0 if hardly any patch is flat."""
    mask = flat.to(brightness)
    correlation = _correlation(brightness, mask, torch.ones_like(mask))
    return torch.where(mask.mean(dim=(1, 2, 3)) > LEAST_SHARE, correlation, 0)


def _highlights(image: Tensor) -> Tensor:
    """Skewness (B,) of the image minus its mean over 5x5 pixels."""
    window = min(5, 2 * ((min(image.shape[-2:]) - 1) // 2) + 1)
    if window == 1:
        return image.new_zeros(len(image))
    blurred = avg_pool2d(pad(image, (window // 2,) * 4, mode="reflect"), window, stride=1)
    detail = image - blurred
    energy = detail.square().mean(dim=(1, 2, 3))
    visible = energy > INVISIBLE_STD**2
    return torch.where(visible, detail.pow(3).mean(dim=(1, 2, 3)) / torch.where(visible, energy, 1).pow(1.5), 0)


def _correlation(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Weighted Pearson correlation (B,); 0 where it is not defined."""
    total = weight.sum(dim=(1, 2, 3), keepdim=True)
    total = torch.where(total > 0, total, 1)
    a, b = (x - (weight * x).sum(dim=(1, 2, 3), keepdim=True) / total for x in (a, b))
    product, aa, bb = ((weight * x).sum(dim=(1, 2, 3)) for x in (a * b, a * a, b * b))
    size = (aa * bb).sqrt()
    return torch.where(size > 1e-12, product / torch.where(size > 1e-12, size, 1), 0)
