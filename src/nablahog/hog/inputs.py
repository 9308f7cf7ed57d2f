"""Names of presets where specs are expected; warnings of odd images."""

from __future__ import annotations

import warnings

from torch import Tensor

from ..inputs.images import warn_about_levels
from ..inputs.numbers import shortened
from ..runtime.text import did_you_mean
from . import presets
from .spec import COLOURS, HOGSpec

_CALLER = 4  # frames up: this file's two, the operator, and the line that called it

DEFAULT_SPECS: dict[str, HOGSpec] = {name: getattr(presets, name)() for name in presets.__all__}
"""The dialects of all presets with their defaults."""


def as_spec(spec: HOGSpec | str) -> HOGSpec:
    """A spec, or the preset of that name with its defaults.

    Raises:
        TypeError: it is neither a spec nor a name.
        ValueError: there is no such preset.
    """
    if isinstance(spec, HOGSpec):
        return spec
    if not isinstance(spec, str):
        raise TypeError(f"spec must be a HOGSpec or the name of a preset, got {type(spec).__name__}")
    if spec not in DEFAULT_SPECS:
        names = ", ".join(DEFAULT_SPECS)
        advice = did_you_mean(spec, DEFAULT_SPECS)
        raise ValueError(f"spec must be a HOGSpec or one of {names}, got {shortened(spec)}{advice}")
    return DEFAULT_SPECS[spec]


def warn_about_range(images: Tensor, spec: HOGSpec) -> None:
    """Warns of images (B, C, H, W) whose range or channels are seldom meant; by Python's default filter once a line.

    Other devices than the CPU are not waited for.
    """
    channels = images.shape[1]
    if channels == COLOURS + 1:
        _warn(
            "images have 4 channels, and each of them is described; of RGBA images drop the last: write images[:, :3] "
            "for tensors, image.convert('RGB') for PIL"
        )
    if channels == COLOURS and spec.colour == "gray" and spec.layout in ("blocks", "block-vector"):
        _warn(
            "images have 3 channels, which this spec makes gray (Eq. 1); scikit-image refuses them, or takes the "
            "channel of largest gradient: write presets.skimage(channel_axis=-1) for that"
        )
    warn_about_levels(images, stacklevel=_CALLER)


def _warn(text: str) -> None:
    warnings.warn(text, UserWarning, stacklevel=_CALLER)
