"""Checks and repairs of the bytes of a GLB file (Khronos, glTF 2.0) before trimesh parses them."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .polygons import MAX_FACES

MAX_NODES = 10_000  # in a GLB
MAX_GLB_HEADER = 2**24  # bytes; Python's objects take about thirty times as many
SPARE_BYTES = 2**26  # that a GLB may unpack to beyond its own size
MAX_LEVELS = 20 * MAX_NODES  # the number of ancestors, summed over all nodes
MAX_DEPTH = 100  # of a GLB's tree of nodes: a node's place is the product of the matrices of all its ancestors

# extensions that change no geometry and hardly any brightness; others may change what numbers mean, as compression does
_HARMLESS = ("KHR_materials_", "KHR_lights_punctual", "KHR_xmp_json_ld")
# what the geometry and its brightness are made of; names, for instance, are not, which trimesh repeats
_GLB_PARTS: dict[str, tuple[str, ...] | None] = {  # keys of the header, and of each of their entries (None: all keys)
    **dict.fromkeys(("asset", "scene", "accessors", "buffers", "bufferViews", "images", "textures")),
    "scenes": ("nodes",),
    "nodes": ("children", "mesh", "matrix", "translation", "rotation", "scale"),
    "meshes": ("primitives",),
}
_PRIMITIVE = ("attributes", "indices", "material", "mode")
_COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_INSTANCING = "EXT_mesh_gpu_instancing"
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives; in the last two each index but two makes a triangle


def plain_glb(data: bytes) -> bytes:
    """A file with what geometry and brightness are made of alone, and what trimesh does not read written out.

    Raises:
        ValueError: it is damaged, needs an extension that is not known, or would unpack to much more than the file.
        Exception: any other, from parsing a damaged file.
    """
    if data[:4] != b"glTF" or len(data) < 20 or int.from_bytes(data[8:12], "little") > len(data):
        raise ValueError("it does not begin with glTF, or is truncated")
    end = 20 + int.from_bytes(data[12:16], "little")
    if end - 20 > MAX_GLB_HEADER:
        raise ValueError(f"its JSON has more than {MAX_GLB_HEADER:,} bytes")
    header = json.loads(data[20:end])
    for name in header.get("extensionsRequired", ()):
        if not str(name).startswith(_HARMLESS):
            raise ValueError(f"it needs the extension {name}, which is not supported")
    if any(_INSTANCING in node.get("extensions", ()) for node in header.get("nodes", ())):
        raise ValueError(f"it uses the extension {_INSTANCING}, which is not supported")
    for uri in (buffer.get("uri", "data:") for buffer in header.get("buffers", ())):
        if not uri.startswith("data:"):
            raise ValueError(f"it needs the file {uri[:200]!r}, and only GLB files that need no other are read")
    _check_sizes(header, len(data))
    _check_tree(header.get("nodes", ()))
    known = {name: keys for name, keys in _GLB_PARTS.items() if name in header}
    plain = {name: _only(header[name], keys) if keys else header[name] for name, keys in known.items()}
    for mesh in plain.get("meshes", ()):
        mesh["primitives"] = _only(mesh["primitives"], _PRIMITIVE)
    if "materials" in header:
        plain["materials"] = [_plain_material(material) for material in header["materials"]]
    rest = _Chunk(plain, data[end:]).plain(header.get("materials", ()))
    text = json.dumps(plain).encode()
    lengths = [number.to_bytes(4, "little") for number in (20 + len(text) + len(rest), len(text))]
    return b"".join([data[:8], *lengths, data[16:20], text, rest])


class _Chunk:
    """The binary chunk, to which :meth:`plain` adds; the header, which it changes, is to name it."""

    def __init__(self, header: dict[str, Any], chunk: bytes) -> None:
        self.header, self.chunk, self.added = header, chunk, list[bytes]()
        self.accessors, self.views = header.get("accessors", []), header.get("bufferViews", [])
        self.end = len(chunk) - 8 + -len(chunk) % 4

    def plain(self, materials: Sequence[dict[str, Any]]) -> bytes:
        """With what trimesh does not read written out: sparse accessors, fans, colours and places in textures."""
        for accessor in [each for each in self.accessors if "sparse" in each]:
            sparse = accessor.pop("sparse")
            dense = self._numbers(accessor, accessor)
            at = self._numbers({"count": sparse["count"], "type": "SCALAR"}, sparse["indices"])
            dense[at[:, 0]] = self._numbers({**accessor, "count": sparse["count"]}, sparse["values"])
            accessor |= {"bufferView": self._view(dense), "byteOffset": 0}
        for primitive in [each for mesh in self.header.get("meshes", ()) for each in mesh["primitives"]]:
            if primitive.get("mode") == _FAN:
                self._cut(primitive)
            attributes = primitive["attributes"]
            if "COLOR_0" in attributes:  # trimesh takes those of 16 bits for 8
                attributes["COLOR_0"] = self._accessor(self._floats(attributes["COLOR_0"]), 5126)
            if "material" in primitive:
                self._place(attributes, materials[primitive["material"]])
        if not self.added:
            return self.chunk
        self.header["buffers"][0]["byteLength"] = self.end
        padding = b"\0" * (-len(self.chunk) % 4)
        return b"".join([self.end.to_bytes(4, "little"), self.chunk[4:], padding, *self.added])

    def _cut(self, fan: dict[str, Any]) -> None:
        """Makes triangles of a fan."""
        corners = np.arange(self.accessors[fan["attributes"]["POSITION"]]["count"])
        if "indices" in fan:
            accessor = self.accessors[fan["indices"]]
            corners = self._numbers(accessor, accessor)[:, 0]
        parts = np.broadcast_arrays(corners[:1], corners[1:-1], corners[2:])
        triangles = np.stack(parts, axis=1).astype("<u4").reshape(-1, 1)
        fan |= {"mode": _TRIANGLES, "indices": self._accessor(triangles, 5125)}

    def _place(self, attributes: dict[str, int], material: dict[str, Any]) -> None:
        """Makes the first places in textures those of the material's, where its texture is moved, too."""
        texture = _texture(material)
        moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
        number = moved.get("texCoord", texture.get("texCoord", 0))
        if f"TEXCOORD_{number}" not in attributes or not (number or moved):
            return
        turn = moved.get("rotation", 0.0)
        matrix = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        uv = self._floats(attributes[f"TEXCOORD_{number}"]) * moved.get("scale", (1, 1)) @ matrix.T
        attributes["TEXCOORD_0"] = self._accessor((uv + moved.get("offset", (0, 0))).astype("<f4"), 5126)

    def _floats(self, number: int) -> NDArray[np.float32]:
        """The numbers of an accessor; of integers as parts of their type's largest."""
        accessor = self.accessors[number]
        numbers = self._numbers(accessor, accessor)
        scale = np.iinfo(numbers.dtype).max if numbers.dtype.kind in "iu" else 1
        return (numbers / scale).astype("<f4")

    def _accessor(self, numbers: NDArray[Any], kind: int) -> int:
        """A new one of numbers (count, components) of a component type."""
        names = {width: name for name, width in _COMPONENTS.items() if not name.startswith("MAT")}
        shape = {"type": names[numbers.shape[1]], "count": len(numbers), "componentType": kind}
        self.accessors.append({"bufferView": self._view(numbers), **shape})
        return len(self.accessors) - 1

    def _view(self, numbers: NDArray[Any]) -> int:
        self.added.append(numbers.tobytes() + b"\0" * (-numbers.nbytes % 4))
        self.views.append({"buffer": 0, "byteOffset": self.end, "byteLength": numbers.nbytes})
        self.end += len(self.added[-1])
        return len(self.views) - 1

    def _numbers(self, shape: dict[str, Any], place: dict[str, Any]) -> NDArray[Any]:
        """A copy of numbers (count, components) in the binary chunk; zeros where ``place`` names no view of it."""
        kind = np.dtype(_COMPONENT_TYPES[{**shape, **place}["componentType"]])
        count, width = _count(shape, "count"), _COMPONENTS[shape["type"]]
        if "bufferView" not in place:
            return np.zeros((count, width), kind)
        view = self.views[place["bufferView"]]
        if view.get("buffer", 0) != 0 or "uri" in self.header["buffers"][0]:
            raise ValueError("its numbers are not in its binary chunk")
        start = 8 + view.get("byteOffset", 0) + place.get("byteOffset", 0)
        strides = view.get("byteStride", width * kind.itemsize), kind.itemsize
        return np.array(np.ndarray((count, width), kind, self.chunk, start, strides))


def _texture(material: dict[str, Any]) -> dict[str, Any]:
    """Of its colour, and which one it is: number, set of places, extensions."""
    texture: dict[str, Any] = _colour(material).get("baseColorTexture", {})
    return texture


def _only(entries: Any, keys: Collection[str]) -> Any:
    """The entries without what is not under one of the keys."""
    return [{key: value for key, value in entry.items() if key in keys} for entry in entries]


def _plain_material(material: dict[str, Any]) -> dict[str, Any]:
    """Its colour and texture alone."""
    return {"pbrMetallicRoughness": _colour(material)}


def _colour(material: dict[str, Any]) -> dict[str, Any]:
    """Its colour and texture, also by the names of the older model of glossy materials."""
    plain = material.get("pbrMetallicRoughness", {})
    glossy = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    renamed = {key.replace("diffuse", "baseColor"): value for key, value in glossy.items() if key.startswith("diffuse")}
    return {key: value for key, value in {**plain, **renamed}.items() if key.startswith("baseColor")}


def _check_sizes(header: dict[str, Any], size: int) -> None:
    """Refuses a file of ``size`` bytes that would unpack to much more: views may overlap, and nodes share meshes."""
    nodes, accessors = header.get("nodes", ()), header.get("accessors", ())
    views = sum(_count(view, "byteLength") for view in header.get("bufferViews", ()))
    unpacked = sum(
        _count(accessor, "count") * int(_COMPONENT_TYPES[accessor["componentType"]][-1]) * _COMPONENTS[accessor["type"]]
        for accessor in accessors
    )
    meshes = [_size_of_mesh(mesh, accessors) for mesh in header.get("meshes", ())]
    placed = [meshes[node["mesh"]] for node in nodes if "mesh" in node]
    most_bytes, stored = size + SPARE_BYTES, sum(accessor["count"] for accessor in accessors)
    limits = [("nodes", len(nodes), MAX_NODES), ("bytes in views", views, most_bytes)]
    limits += [("bytes in accessors", unpacked, most_bytes)]
    for where, sizes in (("", meshes), (" in its nodes", placed)):
        most = {"primitives": MAX_NODES, "vertices": max(MAX_FACES, stored), "faces": MAX_FACES}
        limits += [(what + where, sum(each[k] for each in sizes), most[what]) for k, what in enumerate(most)]
    for what, number, limit in limits:
        if number > limit:
            raise ValueError(f"at most {limit:,} {what} are allowed, got {number:,}")


def _count(part: dict[str, Any], name: str) -> int:
    count = part[name]
    if type(count) is not int or count < 0:
        raise ValueError(f"{name} must be an integer of at least 0, got {str(count)[:60]}")
    return count


def _size_of_mesh(mesh: dict[str, Any], accessors: Sequence[dict[str, Any]]) -> tuple[int, int, int]:
    """The numbers of its primitives, vertices and faces."""
    vertices = faces = 0
    for primitive in mesh["primitives"]:
        count: int = accessors[primitive["attributes"]["POSITION"]]["count"]
        corners: int = accessors[primitive["indices"]]["count"] if "indices" in primitive else count
        vertices += count
        faces += corners if primitive.get("mode") in (_STRIP, _FAN) else corners // 3
    return len(mesh["primitives"]), vertices, faces


def _check_tree(nodes: Sequence[dict[str, Any]]) -> None:
    parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", ())}
    if len(parents) < sum(len(node.get("children", ())) for node in nodes):
        raise ValueError("its nodes are no tree: one has two parents")
    levels = 0
    for child in parents:
        depth = 0
        while child in parents:
            child, depth = parents[child], depth + 1
            if depth > MAX_DEPTH:
                raise ValueError(f"its nodes are nested in more than {MAX_DEPTH} levels, or in a circle")
        levels += depth
        if levels > MAX_LEVELS:
            raise ValueError(f"at most {MAX_LEVELS:,} nodes above others are allowed, counted from each")
