"""Which of an image and its negative is the photograph?

An unsigned descriptor is the same for both.  What tells them apart is how light makes images:

* a sensor saturates in the light: what is exactly flat is rather white, be it sky or paper;
* shading multiplies reflectance: contrasts are stronger where it is bright;
* small highlights are brighter than their surroundings by more than small shadows are darker.

None is certain.  Each cue is a number that changes its sign with the image; their weighted sum decides.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from ..hog.orientation import magnitude

PATCH = 8  # pixels; smaller images are taken as they are
# mean gradient magnitudes of a patch, images in 0…1
EXACTLY_FLAT, FLAT, TEXTURED = 0.002, 0.006, 0.04  # below the first two, above the last
INVISIBLE = 1e-4  # standard deviation of detail, in 0…1: below it there is none
LEAST_SHARE = 0.02  # of the patches: fewer flat ones say nothing
WEIGHTS = (3.0, 2.0, 0.8, 0.5)  # of the cues, chosen on exact photographs


def brightness_cues(image: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1 to cues (B, 4), positive for a photograph.

    They are: whether exactly flat patches are bright, whether flat ones are, whether strong texture is, and highlights.
    """
    height, width = image.shape[-2:]
    dx = pad(image[..., :, 2:] - image[..., :, :-2], (1, 1)) if width > 2 else torch.zeros_like(image)
    dy = pad(image[..., 2:, :] - image[..., :-2, :], (0, 0, 1, 1)) if height > 2 else torch.zeros_like(image)
    size = min(PATCH, height, width)
    strength, brightness = avg_pool2d(magnitude(dx, dy), size), avg_pool2d(image, size)
    textured = (strength > TEXTURED).to(image)
    cues = (
        _flat_is_bright(strength < EXACTLY_FLAT, brightness),
        _flat_is_bright(strength < FLAT, brightness),
        _correlation(brightness, torch.log(strength + 1e-3), textured),
        _highlights(image),
    )
    return torch.stack(cues, dim=1)


def looks_negative(image: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1 to (B,): whether the negative of each looks more like a photograph."""
    return brightness_cues(image) @ torch.tensor(WEIGHTS, dtype=image.dtype, device=image.device) < 0


def negatives(image: Tensor, confidence: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
    """Which images (B, 1, H, W) in 0…1 are rather negatives, (B,), and the confidence (B,) once these are negated.

    A learned prior's ``confidence`` that they are none decides; where there is no prior, the cues, without any.
    """
    if confidence is None:
        return looks_negative(image), None
    return confidence < 0.5, torch.maximum(confidence, 1 - confidence)


def negated(image: Tensor, which: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1, those ``which`` (B,) replaced by their negatives."""
    return torch.where(which.reshape(-1, 1, 1, 1), 1 - image, image)


def fix_polarity(image: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1, each replaced by its negative where that looks more like a photograph."""
    return negated(image, looks_negative(image))


def _flat_is_bright(flat: Tensor, brightness: Tensor) -> Tensor:
    """Correlation (B,) of being flat with brightness over patches; 0 if hardly any is flat."""
    mask = flat.to(brightness)
    correlation = _correlation(brightness, mask, torch.ones_like(mask))
    return torch.where(mask.mean(dim=(1, 2, 3)) > LEAST_SHARE, correlation, 0)


def _highlights(image: Tensor) -> Tensor:
    """Skewness (B,) of what a mean of 5x5 pixels takes away."""
    window = min(5, 2 * ((min(image.shape[-2:]) - 1) // 2) + 1)
    if window == 1:
        return image.new_zeros(len(image))
    blurred = avg_pool2d(pad(image, (window // 2,) * 4, mode="reflect"), window, stride=1)
    detail = image - blurred
    energy = detail.square().mean(dim=(1, 2, 3))
    visible = energy > INVISIBLE**2
    return torch.where(visible, detail.pow(3).mean(dim=(1, 2, 3)) / torch.where(visible, energy, 1).pow(1.5), 0)


def _correlation(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Weighted Pearson correlation (B,); 0 where it is not defined."""
    total = weight.sum(dim=(1, 2, 3), keepdim=True)
    total = torch.where(total > 0, total, 1)
    a, b = (x - (weight * x).sum(dim=(1, 2, 3), keepdim=True) / total for x in (a, b))
    product, aa, bb = ((weight * x).sum(dim=(1, 2, 3)) for x in (a * b, a * a, b * b))
    size = (aa * bb).sqrt()
    return torch.where(size > 1e-12, product / torch.where(size > 1e-12, size, 1), 0)
