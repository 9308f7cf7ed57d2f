"""The options ``--preset``, ``--set``, ``--cell`` and ``--vote``: the dialect of the inputs."""

from __future__ import annotations

import dataclasses
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...hog import HOGSpec
from ...hog.spec import Vote
from ..arguments.did_you_mean import did_you_mean
from ..arguments.preset_parameters import DEFAULT_DESCRIPTOR, PRESETS, as_text, defaults_of, parameters_of, parsed

CELLS = ("cell_size", "pixels_per_cell")  # what presets call --cell
_VOTES = ("vote", "bilinear_orientations", "bilinear")  # and --vote; the last two are whether votes are linear
_WIDTH_FIRST = ("opencv",)  # whose sizes are (width, height)
_FREE = ("name", "layout", "derivative")  # of a descriptor file: these decide none of its values


def make_spec(name: str, parameters: Mapping[str, Any]) -> HOGSpec:
    """The spec of a preset with these parameters, and the defaults of the command line for the others.

    Raises:
        ValueError: they are out of their range, or do not go together.
    """
    try:
        return PRESETS[name](**{**defaults_of(name), **parameters})
    except ValueError as error:
        options = ", ".join(f"{key}={as_text(value)}" for key, value in parameters.items())
        raise ValueError(f"{name} with {options}: {error}" if options else str(error)) from None


@dataclass(frozen=True)
class SpecOptions:
    """The options that choose a dialect; None where an option is not set.

    Attributes:
        descriptor: a key of :data:`~nablahog.cli.arguments.preset_parameters.PRESETS`.
        cell: (height, width) of a cell in pixels.
        vote: orientation votes, for presets that leave them open.
        settings: parameters of the preset, (name, value) as texts; the last of a name counts.

    Raises:
        ValueError: the preset has no such parameter or cannot have such a value, or two options contradict each other.
    """

    descriptor: str | None = None
    cell: tuple[int, int] | None = None
    vote: Vote | None = None
    settings: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, arguments: Namespace) -> SpecOptions:
        """By the options ``--preset``, ``--cell``, ``--vote`` and ``--set``."""
        return cls(arguments.descriptor, arguments.cell, arguments.vote, tuple(arguments.settings or ()))

    def __post_init__(self) -> None:
        self.spec()

    @property
    def name(self) -> str:
        """The preset."""
        return self.descriptor or DEFAULT_DESCRIPTOR

    def parameters(self) -> dict[str, Any]:
        """The parameters of the preset that options set.

        Raises:
            ValueError: as the class.
        """
        hints, parameters = parameters_of(self.name), {}
        for key, text in self.settings:
            if key not in hints:
                meant = did_you_mean(key, hints)
                raise ValueError(f"--set: {self.name} has no parameter {key!r}, but {', '.join(hints)}{meant}")
            try:
                parameters[key] = parsed(text, hints[key])
            except ValueError as error:
                raise ValueError(f"--set {key}: {error}") from None
        for option, more in (("--cell", self._cell(hints)), ("--vote", self._vote(hints))):
            for key in more.keys() & parameters.keys():
                raise ValueError(f"{option} and --set {key} say the same: expected one of them")
            parameters |= more
        return parameters

    def spec(self) -> HOGSpec:
        """The spec of photographs: the options, completed by the defaults."""
        return make_spec(self.name, self.parameters())

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if ``spec``, of a descriptor file, contradicts the options."""
        separate = {"cell_size": self.cell, "vote": self.vote}
        expected = {}
        if self.descriptor or self.settings:
            keys = dict(self.settings)
            named = {"cell_size": CELLS, "vote": _VOTES}  # compared only if they are set
            whole = self.spec()
            expected = {
                field.name: getattr(whole, field.name)
                for field in dataclasses.fields(whole)
                if field.name not in separate or any(key in keys for key in named[field.name])
            }
        expected |= {field: value for field, value in separate.items() if value}
        differing = [field for field, value in expected.items() if getattr(spec, field) != value]
        if any(field not in _FREE for field in differing):  # but the name, if it differs, says it best
            field = differing[0]
            raise ValueError(
                f"a descriptor of another spec than asked for: its {field} is {getattr(spec, field)!r}, "
                f"not {expected[field]!r}"
            )

    def _cell(self, hints: Mapping[str, Any]) -> dict[str, Any]:
        if self.cell is None:
            return {}
        height, width = self.cell
        (key,) = (key for key in CELLS if key in hints)
        if hints[key] is int:
            if height != width:
                raise ValueError(f"cells of {self.name} are square: expected --cell N, got {height}x{width}")
            return {key: height}
        return {key: (width, height) if self.name in _WIDTH_FIRST else (height, width)}

    def _vote(self, hints: Mapping[str, Any]) -> dict[str, Any]:
        if self.vote is None:
            return {}
        for key in _VOTES:
            if key in hints:
                return {key: self.vote == "linear" if hints[key] is bool else self.vote}
        votes = make_spec(self.name, {}).vote
        if votes != self.vote:
            able = ", ".join(name for name in PRESETS if set(_VOTES) & set(parameters_of(name)))
            raise ValueError(f"the {self.name} descriptor has {votes} votes: --vote {self.vote} goes with {able}")
        return {}
