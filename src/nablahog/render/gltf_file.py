"""GLB and glTF files (Khronos, glTF 2.0): checks before anything is unpacked, then the triangles of all nodes."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from .companion_files import CompanionFiles
from .mesh_bytes import MAX_FACES
from .polygons import BRIGHTNESS, Floats, Integers, Soup, gray_of

MAX_NODES = 10_000  # in a GLB
MAX_GLB_HEADER = 2**24  # bytes; Python's objects take about thirty times as many
SPARE_BYTES = 2**26  # that a GLB may unpack to beyond its own size
MAX_LEVELS = 20 * MAX_NODES  # the number of ancestors, summed over all nodes
MAX_DEPTH = 100  # of a GLB's tree of nodes: a node's place is the product of the matrices of all its ancestors

# extensions that leave the geometry and nearly all brightness; others, such as compression, change what numbers mean
_HARMLESS = ("KHR_materials_", "KHR_lights_punctual", "KHR_xmp_json_ld")
_READ = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
_NEVER_READ = ("EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_meshopt_compression")  # required or not
_COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives; in the last two each index but two makes a triangle

Json = dict[str, Any]


def read_gltf(data: bytes, companions: CompanionFiles) -> Iterator[Soup]:
    """The triangles of each primitive of each node of the scene, where the nodes, or their skeletons, put them.

    Raises:
        ValueError: it is damaged, needs an extension or a file that is not read, would unpack to much more than the
            file, or exceeds a limit.
        Exception: any other, from parsing a damaged file.
    """
    header, binary = _parts(data)
    _check_extensions(header)
    buffers = [_buffer(number, buffer, binary, companions) for number, buffer in enumerate(header.get("buffers", ()))]
    _check_sizes(header, len(data) + sum(map(len, buffers)))
    nodes = header.get("nodes", ())
    _check_tree(nodes)
    scene, places = _Scene(header, buffers, companions), _placed(header)
    for number, place in places.items():
        for primitive, soup in scene.mesh(nodes[number].get("mesh")):
            if "skin" in nodes[number] and "JOINTS_0" in primitive["attributes"]:
                vertices = scene.skinned(soup.vertices, primitive["attributes"], nodes[number]["skin"], places)
            else:
                vertices = soup.vertices @ place[:3, :3].T + place[:3, 3]
            yield Soup(vertices, soup.faces, soup.brightness)


def _parts(data: bytes) -> tuple[Json, bytes]:
    """The header, and the binary part of a GLB."""
    start, end = 0, len(data)
    if data[:4] == b"glTF":
        if data[4:8] != b"\2\0\0\0" or data[16:20] != b"JSON" or int.from_bytes(data[8:12], "little") > len(data):
            raise ValueError("it is truncated, or not of version 2")
        start, end = 20, 20 + int.from_bytes(data[12:16], "little")
    elif not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise ValueError("it does not begin with glTF, or as JSON does")
    if end - start > MAX_GLB_HEADER:
        raise ValueError(f"its JSON has more than {MAX_GLB_HEADER:,} bytes")
    header: Json = json.loads(data[start:end])
    return header, data[end + 8 : end + 8 + int.from_bytes(data[end : end + 4], "little")]


def _buffer(number: int, buffer: Json, binary: bytes, companions: CompanionFiles) -> bytes:
    uri = buffer.get("uri")
    if uri is None:
        if number:
            raise ValueError("it has more than one buffer in its binary part")
        return binary
    if uri.startswith("data:"):
        return _decoded(uri)
    try:
        return companions.read(unquote(uri))
    except (OSError, ValueError):
        reason = f"it needs the file {uri[:200]!r}, which is not beside it; save the model as GLB, which needs no other"
        raise ValueError(reason) from None


def _decoded(uri: str) -> bytes:
    return base64.b64decode(uri.partition(",")[2])


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


def _placed(header: Json) -> dict[int, Floats]:
    """The numbers of the scene's nodes, and the matrices (4, 4) that put them into it."""
    nodes = header.get("nodes", ())
    if "scenes" in header:
        roots = header["scenes"][header.get("scene", 0)].get("nodes", ())
    else:  # all that is on the top
        below = {child for node in nodes for child in node.get("children", ())}
        roots = [number for number in range(len(nodes)) if number not in below]
    places: dict[int, Floats] = {}
    left = [(root, np.eye(4)) for root in reversed(roots)]
    while left:
        number, parent = left.pop()
        places[number] = parent @ _matrix(nodes[number])
        left += [(child, places[number]) for child in reversed(nodes[number].get("children", ()))]
    return places


def _matrix(node: Json) -> Floats:
    """(4, 4): a node's place in the one above."""
    if "matrix" in node:
        stored: Floats = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T  # column by column
        return stored
    quaternion = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    x, y, z, w = quaternion / max(float(np.linalg.norm(quaternion)), 1e-12)
    rotation = np.eye(3) + 2 * np.array(
        [
            [-y * y - z * z, x * y - z * w, x * z + y * w],
            [x * y + z * w, -x * x - z * z, y * z - x * w],
            [x * z - y * w, y * z + x * w, -x * x - y * y],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


class _Scene:
    """The meshes of a file, and the buffers that their numbers are in."""

    def __init__(self, header: Json, buffers: Sequence[bytes], companions: CompanionFiles) -> None:
        self.header, self.buffers, self.companions = header, buffers, companions
        self._meshes: dict[int, list[tuple[Json, Soup]]] = {}

    def mesh(self, number: int | None) -> list[tuple[Json, Soup]]:
        """The primitives of a mesh that have triangles, with these; of None, none."""
        if number is None:
            return []
        if number not in self._meshes:
            primitives = self.header["meshes"][number]["primitives"]
            self._meshes[number] = [
                (primitive, self._soup(primitive))
                for primitive in primitives
                if primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN)
            ]
        return self._meshes[number]

    def _soup(self, primitive: Json) -> Soup:
        attributes = primitive["attributes"]
        vertices = self.numbers(attributes["POSITION"]).astype(np.float64)
        if vertices.shape[1] != 3:
            raise ValueError("its vertices do not have three coordinates each")
        corners = self.numbers(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        material = self.header["materials"][primitive["material"]] if "material" in primitive else {}
        brightness = self._brightness(material, attributes, len(vertices))
        return Soup(vertices, _triangles(corners.astype(np.int64), primitive.get("mode", _TRIANGLES)), brightness)

    def _brightness(self, material: Json, attributes: dict[str, int], count: int) -> Floats:
        """The product of those of texture, vertices and material, as far as they are known."""
        base = dict(material.get("pbrMetallicRoughness", {}))
        older = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})  # which replaces them
        base |= {f"baseColor{key.removeprefix('diffuse')}": older[key] for key in older if key.startswith("diffuse")}
        factors = []
        if "baseColorTexture" in base:
            factors.append(self._sampled(base["baseColorTexture"], attributes, count))
        if "COLOR_0" in attributes:
            factors.append(gray_of(self.numbers(attributes["COLOR_0"])))
        if "baseColorFactor" in base:
            colour = np.array(base["baseColorFactor"], dtype=np.float64)
            factors.append(gray_of(colour[None]).repeat(count))
        known = [factor for factor in factors if factor is not None and len(factor) == count]
        product: Floats = np.prod(known, axis=0) if known else np.full(count, BRIGHTNESS)
        return product

    def _sampled(self, texture: Json, attributes: dict[str, int], count: int) -> Floats | None:
        """The brightness of a texture at the vertices, moved as KHR_texture_transform says."""
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        chosen = attributes.get(f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}")
        if chosen is None or self.header["accessors"][chosen]["count"] != count:
            return None
        angle = transform.get("rotation", 0)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        places = self.numbers(chosen) * transform.get("scale", (1, 1)) @ turn + transform.get("offset", (0, 0))
        upwards = places * [1, -1] + [0, 1]
        source = self.header["textures"][texture["index"]]
        number = source.get("extensions", {}).get("EXT_texture_webp", source).get("source", source.get("source"))
        image = self.header["images"][number]
        uri = image.get("uri", "data:")
        if not uri.startswith("data:"):
            return self.companions.sample(uri, upwards)
        view = image.get("bufferView")
        return self.companions.sample(
            f"image {number}", upwards, lambda: _decoded(uri) if view is None else bytes(self._view(view))
        )

    def skinned(self, vertices: Floats, attributes: dict[str, int], skin: int, places: dict[int, Floats]) -> Floats:
        """Vertices (N, 3) where the joints of a skeleton put them; the node of the mesh does not count."""
        joints, accessor = self.header["skins"][skin]["joints"], self.header["skins"][skin].get("inverseBindMatrices")
        moved = np.stack([places.get(joint, np.eye(4)) for joint in joints])
        if accessor is not None:
            moved = moved @ self.numbers(accessor).astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
        weights, which = self.numbers(attributes["WEIGHTS_0"]).astype(np.float64), self.numbers(attributes["JOINTS_0"])
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        homogeneous = np.pad(vertices, ((0, 0), (0, 1)), constant_values=1)
        placed = np.zeros_like(vertices)
        for weight, joint in zip(weights.T, which.T, strict=True):
            placed += weight[:, None] * np.einsum("nij,nj->ni", moved[joint, :3], homogeneous)
        return placed

    def _view(self, number: int) -> memoryview:
        view = self.header["bufferViews"][number]
        start = view.get("byteOffset", 0)
        return memoryview(self.buffers[view.get("buffer", 0)])[start : start + view["byteLength"]]

    def numbers(self, accessor: int) -> NDArray[Any]:
        """The numbers (count, components) of an accessor; integers that stand for fractions as these."""
        described = self.header["accessors"][accessor]
        numbers, sparse = self._stored(described, described), described.get("sparse")
        if sparse is not None:
            at = self._stored({"count": sparse["count"], "type": "SCALAR"}, sparse["indices"])
            numbers[at[:, 0]] = self._stored({**described, "count": sparse["count"]}, sparse["values"])
        if described.get("normalized", False) and numbers.dtype.kind in "iu":
            numbers = (numbers / np.float32(np.iinfo(numbers.dtype).max)).clip(-1)
        return numbers

    def _stored(self, shape: Json, place: Json) -> NDArray[Any]:
        """A copy of numbers (count, components); zeros where ``place`` names no view."""
        kind = np.dtype(_COMPONENT_TYPES[{**shape, **place}["componentType"]])
        count, width = _count(shape, "count"), _COMPONENTS[shape["type"]]
        if "bufferView" not in place:
            return np.zeros((count, width), kind)
        view = self.header["bufferViews"][place["bufferView"]]
        strides = view.get("byteStride", width * kind.itemsize), kind.itemsize
        stored = self._view(place["bufferView"])
        return np.array(np.ndarray((count, width), kind, stored, place.get("byteOffset", 0), strides))


def _triangles(corners: Integers, mode: int) -> Integers:
    """Triangles (F, 3) of a primitive; their orientation does not matter."""
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    first = corners[:-2] if mode == _STRIP else corners[:1]
    return np.stack(np.broadcast_arrays(first, corners[1:-1], corners[2:]), axis=1)


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
