"""A kind of descriptor: a preset by its name, and its parameters as texts."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from ..hog import HOGSpec, presets
from ..runtime.text import did_you_mean
from .options import SETTING, choice, option

PRESETS: dict[str, Callable[..., HOGSpec]] = {name: getattr(presets, name) for name in presets.__all__}
DEFAULT_PRESET = "uoctti"
_OTHER_DEFAULTS: dict[str, dict[str, Any]] = {"aubry": {"cell_size": 8}}  # not the 5 of the preset
_EXPECTED = {
    int: "an integer of at most six digits",
    float: "a number",
    bool: "true or false",
    tuple: "two integers such as 8x8",
    NoneType: "none",
}
_ONLY_IF_SET = {"cell_size": ("cell_size", "pixels_per_cell"), "vote": ("vote", "bilinear_orientations", "bilinear")}
"""Fields of a descriptor file that need not be the preset's default, and the parameters that ask for a value."""
_FREE = ("name", "layout", "derivative")  # fields that decide none of the values in a descriptor file


def preset_parameters(name: str) -> dict[str, Any]:
    """The parameters of a preset with their types, in order."""
    hints = get_type_hints(PRESETS[name])
    return {parameter: hints[parameter] for parameter in inspect.signature(PRESETS[name]).parameters}


def other_defaults(name: str) -> dict[str, Any]:
    """The parameters of a preset whose defaults on the command line are other than the preset's."""
    return _OTHER_DEFAULTS.get(name, {})


def preset_defaults(name: str) -> dict[str, Any]:
    """The parameters of a preset with their defaults on the command line."""
    parameters = inspect.signature(PRESETS[name]).parameters.values()
    return {parameter.name: parameter.default for parameter in parameters} | other_defaults(name)


def opencv_window_size(name: str, parameters: Mapping[str, Any]) -> tuple[int, int] | None:
    """(height, width) of OpenCV's window, the size of its images; None for other presets."""
    window = {**preset_defaults(name), **parameters}.get("win_size")
    return None if window is None else (window[1], window[0])


def as_text(value: object) -> str:
    """The text of a parameter's value."""
    if isinstance(value, tuple):
        return "x".join(map(str, value))
    return str(value).lower() if value is None or isinstance(value, bool) else str(value)


def parse_value(text: str, hint: Any) -> Any:
    """The value of type ``hint`` that ``text`` stands for, the inverse of :func:`as_text`.

    Raises:
        ValueError: ``text`` is no such value; the message says what was expected.
    """
    # Python 3.10 reads a parameter `int | None = None` as Optional
    kinds = get_args(hint) if get_origin(hint) in (UnionType, Union) else (hint,)
    for kind in kinds:
        with suppress(ValueError):
            return _value(text, kind)
    expected = [
        f"one of {', '.join(get_args(kind))}" if get_origin(kind) is Literal else _EXPECTED[get_origin(kind) or kind]
        for kind in kinds
    ]
    raise ValueError(f"expected {' or '.join(expected)}, got {text!r}")


def _value(text: str, kind: Any) -> Any:
    """Raises ValueError, without a message, if ``text`` is not of this kind."""
    if get_origin(kind) is tuple:
        sides = re.split("[x×]", text)
        if len(sides) > 2:
            raise ValueError
        return _value(sides[0], int), _value(sides[-1], int)
    if kind is int and re.fullmatch(r"-?\d{1,6}", text, re.ASCII):  # larger ones could not be computed
        return int(text)
    if kind is float and math.isfinite(float(text)):
        return float(text)
    named = {"true": True, "false": False} if kind is bool else {"none": None} if kind is NoneType else {}
    if get_origin(kind) is Literal:
        named = {choice: choice for choice in get_args(kind)}
    for name, value in named.items():
        if text.lower() == name.lower():
            return value
    raise ValueError


def make_spec(name: str, parameters: Mapping[str, Any]) -> HOGSpec:
    """The spec of a preset with these parameters, and the defaults of the command line for the others."""
    try:
        return PRESETS[name](**{**preset_defaults(name), **parameters})
    except ValueError as error:
        options = ", ".join(f"{key}={as_text(value)}" for key, value in parameters.items())
        raise ValueError(f"{name} with {options}: {error}" if options else str(error)) from None


def presets_with(settings: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """The presets that have all of these parameters, with their values."""
    presets: dict[str, dict[str, Any]] = {}
    for name in PRESETS:
        with suppress(ValueError):
            presets[name] = Dialect(preset=name, settings=settings).parameters()
    return presets


@dataclass(frozen=True)
class Dialect:
    """The kind of a descriptor."""

    preset: str | None = option(
        None, f"kind of descriptor: {', '.join(PRESETS)}", choice(PRESETS), on_page=True, stands_for=DEFAULT_PRESET
    )
    settings: Mapping[str, str] = option(
        dict,
        "a parameter of the preset, as in nablahog.presets, such as cell_size=8x6; may be repeated",
        SETTING,
        flag="--set",
        on_page=True,
    )

    def __post_init__(self) -> None:
        _ = self.spec  # raises what is wrong with the settings

    @property
    def name(self) -> str:
        """The preset."""
        return self.preset or DEFAULT_PRESET

    def parameters(self) -> dict[str, Any]:
        """The parameters of the preset that are set, with their values."""
        hints, parameters = preset_parameters(self.name), {}
        for key, text in self.settings.items():
            if key not in hints:
                raise ValueError(self._refuse_parameter(key))
            try:
                parameters[key] = parse_value(text, hints[key])
            except ValueError as error:
                raise ValueError(f"{key}: {error}") from None
        return parameters

    def _refuse_parameter(self, key: str) -> str:
        """A sentence about a parameter that the preset has not; without a preset, it says which have it."""
        own = preset_parameters(self.name)
        having = [name for name in PRESETS if key in preset_parameters(name)]
        if self.preset is not None:
            return f"{self.name} has no parameter {key!r}; it has {', '.join(own)}{did_you_mean(key, own)}"
        if having:
            return (
                f"{self.name}, which is meant without `preset`, has no parameter {key!r}; {', '.join(having)} "
                f"{'has' if len(having) == 1 else 'have'} it: expected one of these as `preset`"
            )
        every = {parameter for name in PRESETS for parameter in preset_parameters(name)}
        return f"no preset has a parameter {key!r}{did_you_mean(key, every)}"

    @cached_property
    def spec(self) -> HOGSpec:
        """The spec of photographs: what was asked for, completed by the defaults."""
        return make_spec(self.name, self.parameters())

    @property
    def python(self) -> str:
        """The Python that makes the spec."""
        parameters = {**other_defaults(self.name), **self.parameters()}
        return f"nablahog.presets.{self.name}({', '.join(f'{name}={value!r}' for name, value in parameters.items())})"

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if ``spec``, of a descriptor file, contradicts what was asked for."""
        if self.preset is None and not self.settings:
            return
        preset = spec.name.replace("-", "_")
        if self.preset is None and preset in PRESETS:  # the parameters are those of its preset
            return Dialect(preset=preset, settings=self.settings).check(spec)
        compared = [
            field.name
            for field in dataclasses.fields(self.spec)
            if field.name not in _ONLY_IF_SET or not {*_ONLY_IF_SET[field.name]}.isdisjoint(self.settings)
        ]
        differing = [name for name in compared if getattr(spec, name) != getattr(self.spec, name)]
        if set(differing) - {*_FREE}:
            field = differing[0]  # the name, if it differs, says it best
            raise ValueError(
                f"a descriptor of another spec than asked for: its {field} is {getattr(spec, field)!r}, "
                f"not {getattr(self.spec, field)!r}"
            )
