"""Names of presets where specs are expected."""

from __future__ import annotations

from collections.abc import Mapping

from ..inputs.numbers import shortened
from ..runtime.text import did_you_mean
from . import presets
from .spec import HOGSpec

DEFAULT_SPECS: dict[str, HOGSpec] = {name: getattr(presets, name)() for name in presets.__all__}
"""The dialects of all presets with their defaults."""


def refuse_settings(owner: str, spec: object, settings: Mapping[str, object]) -> None:
    """Raises TypeError with what to write if settings of a spec are given to a module beside it."""
    if settings:
        names = ", ".join(settings)
        preset = spec if isinstance(spec, str) and spec in DEFAULT_SPECS else _name_of_preset(spec) or "uoctti"
        given = ", ".join(f"{name}={value!r}" for name, value in settings.items())
        raise TypeError(
            f"{owner} takes no {names}: settings belong to the spec, write {owner}(nablahog.presets.{preset}({given}))"
        )


def as_spec(spec: HOGSpec | str | None) -> HOGSpec:
    """A spec, or the preset of that name with its defaults.

    Raises:
        TypeError: it is neither a spec nor a name.
        ValueError: there is no such preset.
    """
    if isinstance(spec, HOGSpec):
        return spec
    if not isinstance(spec, str):
        raise TypeError(
            f"spec must be a HOGSpec or the name of a preset, got {shortened(spec)}: write {_advise_on_spec(spec)}"
        )
    if spec not in DEFAULT_SPECS:
        names = ", ".join(DEFAULT_SPECS)
        advice = did_you_mean(spec, DEFAULT_SPECS)
        raise ValueError(f"spec must be a HOGSpec or one of {names}, got {shortened(spec)}{advice}")
    return DEFAULT_SPECS[spec]


def _advise_on_spec(value: object) -> str:
    """What to write in place of a value that is neither a spec nor a name."""
    preset = _name_of_preset(value)
    if preset:
        return f"nablahog.presets.{preset}(), or {preset!r}"
    if isinstance(getattr(value, "spec", None), HOGSpec):
        return "its `spec`"
    return "'uoctti', or nablahog.presets.uoctti(cell_size=4) for other settings"


def _name_of_preset(value: object) -> str:
    """The name of a preset's function; empty for other values."""
    return next((name for name in presets.__all__ if getattr(presets, name) is value), "")
