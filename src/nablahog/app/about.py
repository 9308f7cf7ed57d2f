"""The choices that the page offers: presets and their parameters, samples, limits."""

from __future__ import annotations

from importlib.metadata import version
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from ..cli.arguments.presets import DEFAULT_PRESET, PRESETS, as_text, defaults_of, parameters_of
from ..hog import HOGSpec
from ..hog.presets import BY_NAME
from ..invert.histograms import searchable
from ..paper.learned import shipped_files
from ..pose.options import SearchMethod
from .access import MOST_BYTES
from .requests import INVERT_SIZE, SEE_SIZE, Method
from .store import MeshEntry, Photograph, Store

KINDS = {int: "integer", float: "number", bool: "boolean", tuple: "pair"}
RANGES = {
    **dict.fromkeys(("cell_size", "pixels_per_cell"), (2, 32)),
    **dict.fromkeys(("bins", "orientations", "nbins"), (3, 36)),
}
"""Ranges of sliders; other values can be typed."""


def about(store: Store) -> dict[str, Any]:
    """The answer of ``/api/about``."""
    shipped = shipped_files()
    return {
        "version": version("nablahog"),
        "default_preset": DEFAULT_PRESET,
        "presets": [_preset(name, BY_NAME[name]) for name in PRESETS],
        "samples": [
            {
                "id": key,
                "name": each.name,
                "width": each.size[1],
                "height": each.size[0],
                "box": each.box,
                "focal": each.focal,
                "own": key.startswith("photo-"),
            }
            for key, each in store.pinned(Photograph).items()
        ],
        "meshes": [{"id": key, "name": each.name} for key, each in store.pinned(MeshEntry).items()],
        "priors": {"signed": "prior" in shipped, "unsigned": "unsigned-prior" in shipped},
        "limits": {"upload_bytes": MOST_BYTES, "see_size": SEE_SIZE, "invert_size": INVERT_SIZE},
        "methods": list(get_args(Method)),
        "qualities": ["best", "fast"],
        "pose_methods": list(get_args(SearchMethod)),
    }


def _preset(name: str, spec: HOGSpec) -> dict[str, Any]:
    defaults = defaults_of(name)
    return {
        "name": name,
        "signed": searchable(spec).signed,
        "title": (PRESETS[name].__doc__ or name).strip().split("\n")[0],
        "parameters": [_parameter(key, hint, defaults[key]) for key, hint in parameters_of(name).items()],
    }


def _parameter(name: str, hint: Any, default: object) -> dict[str, Any]:
    kinds = get_args(hint) if get_origin(hint) in (UnionType, Union) else (hint,)
    kind = next(each for each in kinds if each is not NoneType)
    least, most = RANGES.get(name, (None, None)) if kind is int else (None, None)
    return {
        "name": name,
        "kind": "choice" if get_origin(kind) is Literal else KINDS[get_origin(kind) or kind],
        "default": as_text(default),
        "choices": list(map(str, get_args(kind))) if get_origin(kind) is Literal else None,
        "optional": NoneType in kinds,
        "least": least,
        "most": most,
    }
