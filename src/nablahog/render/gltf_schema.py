"""The types and ranges of all that is read of a glTF file's JSON: whoever reads it after the check meets no others."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

Json = dict[str, Any]
_Rule = Callable[[Any, str, Json], None]  # of a value, its place such as nodes[3].mesh, and the whole header

_MAX_INTEGER = 2**53  # that JSON's numbers hold exactly
_MAX_NUMBER = 1e300


def parse_header(text: bytes) -> Json:
    """The JSON of a glTF file; what is null counts as absent.

    Raises:
        ValueError: it is damaged, or a part that is read has another type or range than glTF's.
    """
    try:
        header: Json = json.loads(text, object_hook=_drop_nulls)
    except json.JSONDecodeError as error:
        raise ValueError(f"its JSON is damaged: {error}") from None
    except (ValueError, RecursionError):
        raise ValueError("its JSON is damaged, or nested too deeply") from None
    _object(_HEADER)(header, "its JSON", header)
    return header


def _drop_nulls(part: Json) -> Json:
    return {name: value for name, value in part.items() if value is not None}


def refuse(place: str, expected: str, value: Any) -> NoReturn:
    kinds: dict[type, str] = {list: "a list", dict: "an object"}
    raise ValueError(f"{place} must be {expected}, got {kinds.get(type(value)) or repr(value)[:60]}")


def _text(value: Any, place: str, header: Json) -> None:
    if not isinstance(value, str):
        refuse(place, "a text", value)


def _count(value: Any, place: str, header: Json) -> None:
    if type(value) is not int or not 0 <= value <= _MAX_INTEGER:
        refuse(place, "an integer of at least 0", value)


def _number(value: Any, place: str, header: Json) -> None:
    if type(value) not in (int, float) or not abs(value) < _MAX_NUMBER:
        refuse(place, "a finite number", value)


def _index(name: str) -> _Rule:
    """Of a part of the header's list of this name."""

    def check(value: Any, place: str, header: Json) -> None:
        parts = header.get(name)
        count = len(parts) if isinstance(parts, list) else 0
        if type(value) is not int or not 0 <= value < count:
            refuse(place, f"an index below {count}, the number of {name}", value)

    return check


def _key(choices: Mapping[Any, Any]) -> _Rule:
    def check(value: Any, place: str, header: Json) -> None:
        if isinstance(value, (list, dict)) or value not in choices:
            refuse(place, "one of " + ", ".join(map(str, choices)), value)

    return check


def _list(rule: _Rule, *lengths: int) -> _Rule:
    """Of values of a rule; of any length if none is given."""

    def check(value: Any, place: str, header: Json) -> None:
        if not isinstance(value, list) or (lengths and len(value) not in lengths):
            refuse(place, f"a list of {' or '.join(map(str, lengths))} numbers" if lengths else "a list", value)
        for number, part in enumerate(value):
            rule(part, f"{place}[{number}]", header)

    return check


def _object(rules: Mapping[str, _Rule], others: _Rule | None = None) -> _Rule:
    """With a rule for each name that is read, if it is there, and perhaps one for all other names."""

    def check(value: Any, place: str, header: Json) -> None:
        if not isinstance(value, dict):
            refuse(place, "an object", value)
        prefix = "" if value is header else f"{place}."
        for name in value if others else rules:
            if name in value and (rule := rules.get(name, others)):
                rule(value[name], f"{prefix}{name}", header)

    return check


def _scene(value: Any, place: str, header: Json) -> None:
    if header.get("scenes"):  # without scenes, all nodes are shown
        _index("scenes")(value, place, header)


_TRANSFORM = _object({"offset": _list(_number, 2), "scale": _list(_number, 2), "rotation": _number})
_TEXTURE = _object({"index": _index("textures"), "extensions": _object({"KHR_texture_transform": _TRANSFORM})})
_COLOUR = _list(_number, 3, 4)
_OLDER_MATERIAL = _object({"diffuseTexture": _TEXTURE, "diffuseFactor": _COLOUR})
_MATERIAL = {
    "pbrMetallicRoughness": _object({"baseColorTexture": _TEXTURE, "baseColorFactor": _COLOUR}),
    "extensions": _object({"KHR_materials_pbrSpecularGlossiness": _OLDER_MATERIAL}),
}
_SOURCE = {"source": _index("images")}
_STORED = {"bufferView": _index("bufferViews"), "byteOffset": _count, "componentType": _key(COMPONENT_TYPES)}
_SPARSE = _object({"count": _count, "indices": _object(_STORED), "values": _object(_STORED)})
_PRIMITIVE = {
    "attributes": _object({}, _index("accessors")),
    "indices": _index("accessors"),
    "material": _index("materials"),
}
_NODE = {
    "mesh": _index("meshes"),
    "skin": _index("skins"),
    "children": _list(_index("nodes")),
    "weights": _list(_number),
    "matrix": _list(_number, 16),
    "rotation": _list(_number, 4),
    "scale": _list(_number, 3),
    "translation": _list(_number, 3),
}
_PARTS: dict[str, dict[str, _Rule]] = {
    "buffers": {"uri": _text, "byteLength": _count},
    "bufferViews": {"buffer": _index("buffers"), "byteOffset": _count, "byteLength": _count, "byteStride": _count},
    "accessors": {**_STORED, "count": _count, "type": _key(COMPONENTS), "sparse": _SPARSE},
    "images": {"uri": _text, "bufferView": _index("bufferViews")},
    "textures": {**_SOURCE, "extensions": _object({"EXT_texture_webp": _object(_SOURCE)})},
    "materials": _MATERIAL,
    "meshes": {"primitives": _list(_object(_PRIMITIVE)), "weights": _list(_number)},
    "nodes": _NODE,
    "skins": {"joints": _list(_index("nodes")), "inverseBindMatrices": _index("accessors")},
    "scenes": {"nodes": _list(_index("nodes"))},
}
_HEADER = {
    "extensionsUsed": _list(_text),
    "extensionsRequired": _list(_text),
    **{name: _list(_object(rules)) for name, rules in _PARTS.items()},
    "scene": _scene,
}
