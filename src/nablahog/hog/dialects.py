"""Dialects by the name of their preset."""

from __future__ import annotations

from ..runtime.text import did_you_mean
from . import presets
from .checks import shortened
from .spec import HOGSpec

BY_NAME: dict[str, HOGSpec] = {name: getattr(presets, name)() for name in presets.__all__}
"""Each with its defaults."""


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
    if spec not in BY_NAME:
        raise ValueError(
            f"spec must be a HOGSpec or one of {', '.join(BY_NAME)}, got {shortened(spec)}{did_you_mean(spec, BY_NAME)}"
        )
    return BY_NAME[spec]
