"""The options ``--preset`` and ``--set``: the spec of the inputs."""

from __future__ import annotations

import dataclasses
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...hog import HOGSpec
from ..arguments.options import did_you_mean
from ..arguments.preset_parameters import DEFAULT_PRESET, PRESETS, as_text, defaults_of, parameters_of, parsed

_ONLY_IF_SET = {"cell_size": ("cell_size", "pixels_per_cell"), "vote": ("vote", "bilinear_orientations", "bilinear")}
"""Fields of a descriptor file that need not be the preset's default, and the parameters that ask for a value."""
_FREE = ("name", "layout", "derivative")  # fields that decide none of the values in a descriptor file


def make_spec(name: str, parameters: Mapping[str, Any]) -> HOGSpec:
    """The spec of a preset with these parameters, and the defaults of the command line for the others."""
    try:
        return PRESETS[name](**{**defaults_of(name), **parameters})
    except ValueError as error:
        options = ", ".join(f"{key}={as_text(value)}" for key, value in parameters.items())
        raise ValueError(f"{name} with {options}: {error}" if options else str(error)) from None


@dataclass(frozen=True)
class SpecOptions:
    """The options that choose a spec.

    Attributes:
        preset: a key of :data:`~nablahog.cli.arguments.preset_parameters.PRESETS`; None if it was not chosen.
        settings: parameters of the preset, (name, value) as texts; the last of a name counts.
    """

    preset: str | None = None
    settings: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, arguments: Namespace) -> SpecOptions:
        """By the options ``--preset`` and ``--set``."""
        return cls(arguments.preset, tuple(arguments.settings or ()))

    def __post_init__(self) -> None:
        self.spec()

    @property
    def name(self) -> str:
        """The preset."""
        return self.preset or DEFAULT_PRESET

    def parameters(self) -> dict[str, Any]:
        """The parameters of the preset that options set."""
        hints, parameters = parameters_of(self.name), {}
        for key, text in self.settings:
            if key not in hints:
                meant = did_you_mean(key, hints)
                raise ValueError(f"--set: {self.name} has no parameter {key!r}, but {', '.join(hints)}{meant}")
            try:
                parameters[key] = parsed(text, hints[key])
            except ValueError as error:
                raise ValueError(f"--set {key}: {error}") from None
        return parameters

    def spec(self) -> HOGSpec:
        """The spec of photographs: the options, completed by the defaults."""
        return make_spec(self.name, self.parameters())

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if ``spec``, of a descriptor file, contradicts the options."""
        if self.preset is None and not self.settings:
            return
        expected, set_ones = self.spec(), dict(self.settings)
        compared = [
            field.name
            for field in dataclasses.fields(expected)
            if field.name not in _ONLY_IF_SET or not {*_ONLY_IF_SET[field.name]}.isdisjoint(set_ones)
        ]
        differing = [name for name in compared if getattr(spec, name) != getattr(expected, name)]
        if set(differing) - {*_FREE}:
            field = differing[0]  # the name, if it differs, says it best
            raise ValueError(
                f"a descriptor of another spec than asked for: its {field} is {getattr(spec, field)!r}, "
                f"not {getattr(expected, field)!r}"
            )
