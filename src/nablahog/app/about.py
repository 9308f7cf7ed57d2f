"""The choices that the page offers: presets and their parameters, samples, limits."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from ..hog import HOGSpec, presets
from ..invert.histograms import linear_vote_spec
from ..invert.prior.choice import default_prior_file
from ..requests.dialect import DEFAULT_PRESET, PRESETS, as_text, preset_defaults, preset_parameters
from ..requests.options import Option, list_options
from .access import MOST_UPLOAD_BYTES
from .messages import INVERT_SIZE, SEE_SIZE, Fit, HogMessage, InvertMessage
from .store import MeshEntry, Photograph, Store

FIELD_KINDS = {int: "integer", float: "number", bool: "boolean", tuple: "pair"}
RANGES = {
    **dict.fromkeys(("cell_size", "pixels_per_cell"), (2, 32)),
    **dict.fromkeys(("bins", "orientations", "nbins"), (3, 36)),
}
"""Ranges of sliders; other values can be typed."""
WITH_A_CONTROL_OF_THEIR_OWN = ("preset", "settings", "box", "initial", "focal", "principal_point", "distortion")
"""Fields of requests for which the page has more than a control."""


def about(store: Store) -> dict[str, Any]:
    """The answer of ``/api/about``."""
    return {
        "version": version("nablahog"),
        "default_preset": DEFAULT_PRESET,
        "presets": [_preset(name, PRESETS[name]()) for name in PRESETS],
        "samples": [
            {**photograph.facts(key), "box": photograph.box, "own": key.startswith("photo-")}
            for key, photograph in store.pinned(Photograph).items()
        ],
        "meshes": [{"id": key, "name": mesh.name} for key, mesh in store.pinned(MeshEntry).items()],
        "priors": {"signed": _has_prior(presets.uoctti()), "unsigned": _has_prior(presets.paper())},
        "limits": {"upload_bytes": MOST_UPLOAD_BYTES, "see_size": SEE_SIZE, "invert_size": INVERT_SIZE},
        "options": {
            view: [
                _option(option)
                for option in list_options(message)
                if option.on_page and option.name not in WITH_A_CONTROL_OF_THEIR_OWN
            ]
            for view, message in (("see", HogMessage), ("invert", InvertMessage), ("fit", Fit))
        },
    }


def _has_prior(spec: HOGSpec) -> bool:
    file = default_prior_file(spec)
    return file is not None and file.exists()


def _preset(name: str, spec: HOGSpec) -> dict[str, Any]:
    defaults = preset_defaults(name)
    return {
        "name": name,
        "signed": linear_vote_spec(spec).signed,
        "title": (PRESETS[name].__doc__ or name).strip().split("\n")[0],
        "parameters": [_parameter(key, hint, defaults[key]) for key, hint in preset_parameters(name).items()],
    }


def _parameter(name: str, hint: Any, default: object) -> dict[str, Any]:
    """The control of a parameter of a preset."""
    control = _control(name, hint, as_text(default))
    least, most = RANGES.get(name, (None, None)) if control["kind"] == "integer" else (None, None)
    return {**control, "least": least, "most": most, "slider": least is not None}


def _option(option: Option) -> dict[str, Any]:
    """The control of a request's field."""
    label, kind = option.name.replace("_", " ").capitalize(), option.kind
    control = _control(option.name, option.hint, as_text(option.default), option.page_choices)
    return {**control, "label": label, "help": option.help, "least": kind.least, "most": kind.most}


def _control(name: str, hint: Any, default: str, choices: Sequence[str] = ()) -> dict[str, Any]:
    kinds = get_args(hint) if get_origin(hint) in (UnionType, Union) else (hint,)
    kind = next(kind for kind in kinds if kind is not NoneType)
    choices = [*choices] or (list(map(str, get_args(kind))) if get_origin(kind) is Literal else [])
    return {
        "name": name,
        "label": name,
        "help": "",
        "kind": "choice" if choices else FIELD_KINDS[get_origin(kind) or kind],
        "default": default,
        "choices": choices or None,
        "optional": NoneType in kinds,
        "slider": False,
    }
