"""GLB files: checks before anything is unpacked, and what trimesh misreads written out."""

from __future__ import annotations

import base64
import json
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh_bytes import MAX_FACES

MAX_NODES = 10_000  # in a GLB
MAX_GLB_HEADER = 2**24  # bytes; Python's objects take about thirty times as many
SPARE_BYTES = 2**26  # that a GLB may unpack to beyond its own size
MAX_LEVELS = 20 * MAX_NODES  # the number of ancestors, summed over all nodes
MAX_DEPTH = 100  # of a GLB's tree of nodes: a node's place is the product of the matrices of all its ancestors

# extensions that leave the geometry and nearly all brightness; others, such as compression, change what numbers mean
_HARMLESS = ("KHR_materials_", "KHR_lights_punctual", "KHR_xmp_json_ld")
_READ = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
_NEVER_READ = ("EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_meshopt_compression")  # required or not
# what determines geometry and brightness; not names, for instance, which trimesh repeats
_GLB_PARTS: dict[str, tuple[str, ...] | None] = {  # keys of the header, and of each of their entries (None: all keys)
    **dict.fromkeys(("asset", "scene", "accessors", "buffers", "bufferViews", "images", "textures")),
    "scenes": ("nodes",),
    "nodes": ("children", "mesh", "matrix", "translation", "rotation", "scale"),
    "meshes": ("primitives",),
}
_PRIMITIVE = ("attributes", "indices", "material", "mode")
_COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_FLOAT = 5126
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives; in the last two each index but two makes a triangle


def plain_glb(data: bytes) -> bytes:
    """Rewrites a GLB for trimesh: one buffer, nothing that trimesh misreads, nothing but geometry and its brightness.

    Raises:
        ValueError: it is damaged, needs an extension or a file that is not read, would unpack to much more than the
            file, or exceeds a limit.
        Exception: any other, from parsing a damaged file.
    """
    if data[:4] != b"glTF" or len(data) < 20 or int.from_bytes(data[8:12], "little") > len(data):
        raise ValueError("it does not begin with glTF, or is truncated")
    end = 20 + int.from_bytes(data[12:16], "little")
    if end - 20 > MAX_GLB_HEADER:
        raise ValueError(f"its JSON has more than {MAX_GLB_HEADER:,} bytes")
    header = json.loads(data[20:end])
    _check_extensions(header)
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
    if "scenes" not in plain:  # all that is on the top
        below = {child for node in plain.get("nodes", ()) for child in node.get("children", ())}
        plain["scenes"] = [{"nodes": [number for number in range(len(plain.get("nodes", ()))) if number not in below]}]
    binary = _written_out(plain, data[end + 8 : end + 8 + int.from_bytes(data[end : end + 4], "little")])
    text = json.dumps(plain).encode()
    text += b" " * (-len(text) % 4)
    chunks = [len(text).to_bytes(4, "little"), data[16:20], text, len(binary).to_bytes(4, "little"), b"BIN\0", binary]
    return b"".join([data[:8], (12 + sum(map(len, chunks))).to_bytes(4, "little"), *chunks])


def _check_extensions(header: dict[str, Any]) -> None:
    """Refuses a file that is not read, or wrongly, without an extension."""
    used, accessors = header.get("extensionsUsed", ()), header.get("accessors", ())
    needed = [name for name in header.get("extensionsRequired", ()) if not str(name).startswith((*_HARMLESS, *_READ))]
    needed += [name for name in used if name in _NEVER_READ]
    if not all("bufferView" in accessor or "sparse" in accessor for accessor in accessors):  # they are compressed
        needed += [name for name in used if name == "KHR_draco_mesh_compression"]
    if needed:
        raise ValueError(f"it needs the extension {needed[0]}, which is not supported")
    if any(any(part.get("weights", ())) for part in (*header.get("meshes", ()), *header.get("nodes", ()))):
        raise ValueError("it is changed by morph targets, which are not supported")


class _Binary:
    """All buffers of a file as one, to which numbers can be added.  Changes the header."""

    def __init__(self, header: dict[str, Any], binary: bytes) -> None:
        self.views: list[dict[str, Any]] = header.get("bufferViews", [])
        self.parts: list[bytes] = []
        self.end = 0
        starts = []
        for number, buffer in enumerate(header.get("buffers", ())):
            if number and "uri" not in buffer:
                raise ValueError("it has more than one buffer in its binary part")
            starts.append(
                self._append(base64.b64decode(buffer["uri"].partition(",")[2]) if "uri" in buffer else binary)
            )
        for view in self.views:
            view |= {"buffer": 0, "byteOffset": starts[view.get("buffer", 0)] + view.get("byteOffset", 0)}
        self.given = b"".join(self.parts)

    def _append(self, part: bytes) -> int:
        """Returns where it begins."""
        self.parts += [part, b"\0" * (-len(part) % 4)]
        self.end += len(part) + len(self.parts[-1])
        return self.end - len(part) - len(self.parts[-1])

    def add(self, numbers: NDArray[Any]) -> dict[str, Any]:
        """The entries of an accessor of these numbers that say where they are."""
        start = self._append(numbers.tobytes())
        self.views.append({"buffer": 0, "byteOffset": start, "byteLength": numbers.nbytes})
        return {"bufferView": len(self.views) - 1, "byteOffset": 0}

    def read(self, shape: dict[str, Any], place: dict[str, Any]) -> NDArray[Any]:
        """A copy of numbers (count, components) that were given; zeros where ``place`` names no view."""
        kind = np.dtype(_COMPONENT_TYPES[{**shape, **place}["componentType"]])
        count, width = _count(shape, "count"), _COMPONENTS[shape["type"]]
        if "bufferView" not in place:
            return np.zeros((count, width), kind)
        view = self.views[place["bufferView"]]
        start = view["byteOffset"] + place.get("byteOffset", 0)
        strides = view.get("byteStride", width * kind.itemsize), kind.itemsize
        return np.array(np.ndarray((count, width), kind, self.given, start, strides))


def _written_out(header: dict[str, Any], given: bytes) -> bytes:
    """All buffers as one, with what trimesh does not read written out at its end.  Changes the header.

    That is sparse accessors, integers that stand for fractions, fans, and textures that are moved on their surface.
    """
    binary, accessors = _Binary(header, given), header.get("accessors", [])
    for accessor in accessors:
        sparse, is_fraction = accessor.pop("sparse", None), accessor.pop("normalized", False)
        is_fraction = is_fraction and accessor["componentType"] != _FLOAT
        if sparse is None and not is_fraction:
            continue
        dense = binary.read(accessor, accessor)
        if sparse is not None:
            at = binary.read({"count": sparse["count"], "type": "SCALAR"}, sparse["indices"])
            dense[at[:, 0]] = binary.read({**accessor, "count": sparse["count"]}, sparse["values"])
        if is_fraction:
            dense = (dense / np.float32(np.iinfo(dense.dtype).max)).clip(-1).astype("<f4")
            accessor["componentType"] = _FLOAT
        accessor |= binary.add(dense)
    binary.given = b"".join(binary.parts)
    for primitive in [each for mesh in header.get("meshes", ()) for each in mesh["primitives"]]:
        if primitive.get("mode") == _FAN:
            _cut_fan(primitive, accessors, binary)
        _move_texture(primitive, _texture_of(header, primitive), accessors, binary)
    header["buffers"] = [{"byteLength": binary.end}]
    return b"".join(binary.parts)


def _cut_fan(fan: dict[str, Any], accessors: list[dict[str, Any]], binary: _Binary) -> None:
    corners = np.arange(accessors[fan["attributes"]["POSITION"]]["count"])
    if "indices" in fan:
        corners = binary.read(accessors[fan["indices"]], accessors[fan["indices"]])[:, 0]
    triangles = np.stack(np.broadcast_arrays(corners[:1], corners[1:-1], corners[2:]), axis=1).astype("<u4")
    fan |= {"mode": _TRIANGLES, "indices": len(accessors)}
    accessors.append({"componentType": 5125, "type": "SCALAR", "count": triangles.size} | binary.add(triangles))


def _move_texture(
    primitive: dict[str, Any], texture: dict[str, Any], accessors: list[dict[str, Any]], binary: _Binary
) -> None:
    """Gives the primitive the places in its texture that the texture asks for, moved as it says."""
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    chosen = transform.get("texCoord", texture.get("texCoord", 0))
    if not chosen and not transform:
        return
    attributes = primitive["attributes"]
    places, count = attributes.get(f"TEXCOORD_{chosen}"), accessors[attributes["POSITION"]]["count"]
    attributes.pop("TEXCOORD_0", None)
    if places is not None and accessors[places]["count"] == count:
        moved = _moved(binary.read(accessors[places], accessors[places]), transform)
        attributes["TEXCOORD_0"] = len(accessors)
        accessors.append({"componentType": _FLOAT, "type": "VEC2", "count": count} | binary.add(moved))


def _texture_of(header: dict[str, Any], primitive: dict[str, Any]) -> dict[str, Any]:
    if "material" not in primitive:
        return {}
    material: dict[str, dict[str, Any]] = header["materials"][primitive["material"]]["pbrMetallicRoughness"]
    return material.get("baseColorTexture", {})


def _moved(places: NDArray[Any], transform: dict[str, Any]) -> NDArray[np.float32]:
    """Places (N, 2) in a texture as KHR_texture_transform moves them."""
    angle = transform.get("rotation", 0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved: NDArray[np.float32] = places * transform.get("scale", (1, 1)) @ turn + transform.get("offset", (0, 0))
    return moved.astype("<f4")


def _only(entries: Any, keys: Collection[str]) -> Any:
    """The entries without what is not under one of the keys."""
    return [{key: value for key, value in entry.items() if key in keys} for entry in entries]


def _plain_material(material: dict[str, Any]) -> dict[str, Any]:
    """Its colour and texture alone."""
    plain = material.get("pbrMetallicRoughness", {})
    older = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})  # which replaces them
    plain |= {f"baseColor{key.removeprefix('diffuse')}": older[key] for key in older if key.startswith("diffuse")}
    return {"pbrMetallicRoughness": {key: value for key, value in plain.items() if key.startswith("baseColor")}}


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
        raise ValueError("its nodes are not a tree: one has two parents")
    levels = 0
    for child in parents:
        depth = 0
        while child in parents:
            child, depth = parents[child], depth + 1
            if depth > MAX_DEPTH:
                raise ValueError(f"its nodes are nested in more than {MAX_DEPTH} levels, or in a circle")
        levels += depth
        if levels > MAX_LEVELS:
            raise ValueError(f"at most {MAX_LEVELS:,} ancestors are allowed, summed over all nodes")
