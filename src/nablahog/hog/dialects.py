"""Names of presets where specs are expected."""

from __future__ import annotations

from ..inputs.numbers import shortened
from ..runtime.text import did_you_mean
from . import presets
from .spec import HOGSpec

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
        raise TypeError(
            f"spec must be a HOGSpec or the name of a preset, got {type(spec).__name__}: write 'uoctti', or "
            "nablahog.presets.uoctti(cell_size=4) for other settings"
        )
    if spec not in DEFAULT_SPECS:
        names = ", ".join(DEFAULT_SPECS)
        advice = did_you_mean(spec, DEFAULT_SPECS)
        raise ValueError(f"spec must be a HOGSpec or one of {names}, got {shortened(spec)}{advice}")
    return DEFAULT_SPECS[spec]
