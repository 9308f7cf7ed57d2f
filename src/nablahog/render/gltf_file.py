"""GLB and glTF files (Khronos, glTF 2.0): the triangles of all nodes."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from .companion_files import CompanionFiles
from .gltf_checks import FAN, MAX_JSON_BYTES, STRIP, TRIANGLES, check_extensions, check_sizes, check_tree
from .gltf_schema import COMPONENT_TYPES, COMPONENTS, Json, parse_header, refuse
from .soup import BRIGHTNESS, Floats, Integers, Soup, to_gray


def read_gltf(data: bytes, companions: CompanionFiles) -> Iterator[Soup]:
    """The triangles of each primitive of each node of the scene, where the nodes, or their skeletons, put them.

    Raises:
        ValueError: it is damaged, needs an extension or a file that is not read, would unpack to much more than the
            file, or exceeds a limit.
        Exception: any other, from parsing a damaged file.
    """
    header, binary = _split(data)
    check_extensions(header)
    buffers = [
        _check_length(_read_buffer(number, buffer, binary, companions), number, buffer.get("byteLength", 0))
        for number, buffer in enumerate(header.get("buffers", ()))
    ]
    check_sizes(header, len(data) + sum(map(len, buffers)))
    nodes = header.get("nodes", ())
    check_tree(nodes)
    scene, places = _Scene(header, buffers, companions), _place_nodes(header)
    for number, place in places.items():
        for primitive, soup in scene.mesh(nodes[number].get("mesh")):
            if "skin" in nodes[number] and "JOINTS_0" in primitive["attributes"]:
                vertices = scene.pose_skin(soup.vertices, primitive["attributes"], nodes[number]["skin"], places)
            else:
                vertices = soup.vertices @ place[:3, :3].T + place[:3, 3]
            yield Soup(vertices, soup.faces, soup.brightness)


def _split(data: bytes) -> tuple[Json, bytes]:
    """The header, and the binary part of a GLB."""
    start, end = 0, len(data)
    if data[:4] == b"glTF":
        if data[4:8] != b"\2\0\0\0" or data[16:20] != b"JSON" or int.from_bytes(data[8:12], "little") > len(data):
            raise ValueError("it is truncated, or not of version 2")
        start, end = 20, 20 + int.from_bytes(data[12:16], "little")
    elif not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise ValueError("it does not begin with glTF, or as JSON does")
    if end - start > MAX_JSON_BYTES:
        raise ValueError(f"its JSON has more than {MAX_JSON_BYTES:,} bytes")
    return parse_header(data[start:end]), data[end + 8 : end + 8 + int.from_bytes(data[end : end + 4], "little")]


def _read_buffer(number: int, buffer: Json, binary: bytes, companions: CompanionFiles) -> bytes:
    uri = buffer.get("uri")
    if uri is None:
        if number:
            raise ValueError("it has more than one buffer in its binary part")
        return binary
    if uri.startswith("data:"):
        return _decode(uri)
    try:
        return companions.read(unquote(uri))
    except (OSError, ValueError) as error:
        trouble = "which is not beside it" if isinstance(error, OSError) else f"but {error}"
        reason = f"it needs the file {uri[:200]!r}, {trouble}; save the model as GLB, which needs no other"
        raise ValueError(reason) from None


def _check_length(data: bytes, number: int, length: int) -> bytes:
    """The bytes of a buffer, at least ``length``."""
    if len(data) < length:
        raise ValueError(
            f"buffers[{number}]: the buffer is missing or shorter than byteLength says: "
            f"it has {len(data):,} of {length:,} bytes"
        )
    return data


def _decode(uri: str) -> bytes:
    """The bytes in a data URI; none of a damaged one."""
    try:
        return base64.b64decode(uri.partition(",")[2])
    except ValueError:
        return b""


def _place_nodes(header: Json) -> dict[int, Floats]:
    """The numbers of the scene's nodes, and the matrices (4, 4) that put them into it."""
    nodes = header.get("nodes", ())
    if header.get("scenes"):
        roots = header["scenes"][header.get("scene", 0)].get("nodes", ())
    else:  # all that is on the top
        below = {child for node in nodes for child in node.get("children", ())}
        roots = [number for number in range(len(nodes)) if number not in below]
    places: dict[int, Floats] = {}
    remaining = [(root, np.eye(4)) for root in reversed(dict.fromkeys(roots))]
    while remaining:
        number, parent = remaining.pop()
        places[number] = parent @ _matrix(nodes[number])
        remaining += [(child, places[number]) for child in reversed(nodes[number].get("children", ()))]
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
                if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN)
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
        return Soup(vertices, _list_triangles(corners.astype(np.int64), primitive.get("mode", TRIANGLES)), brightness)

    def _brightness(self, material: Json, attributes: dict[str, int], count: int) -> Floats:
        """The product of those of texture, vertices and material, as far as they are known."""
        base = dict(material.get("pbrMetallicRoughness", {}))
        older = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})  # which replaces them
        base |= {f"baseColor{key.removeprefix('diffuse')}": older[key] for key in older if key.startswith("diffuse")}
        factors = []
        if "baseColorTexture" in base:
            factors.append(self._sample(base["baseColorTexture"], attributes, count))
        if "COLOR_0" in attributes and self._belongs(attributes["COLOR_0"], count):
            factors.append(to_gray(self.numbers(attributes["COLOR_0"])))
        if "baseColorFactor" in base:
            colour = np.array(base["baseColorFactor"], dtype=np.float64)
            factors.append(to_gray(colour[None]).repeat(count))
        known = [factor for factor in factors if factor is not None]
        product: Floats = np.prod(known, axis=0) if known else np.full(count, BRIGHTNESS)
        return product

    def _belongs(self, accessor: int, count: int) -> bool:
        """Whether an accessor is of so many vertices."""
        return bool(self.header["accessors"][accessor]["count"] == count)

    def _sample(self, texture: Json, attributes: dict[str, int], count: int) -> Floats | None:
        """The brightness of a texture at the vertices, moved as KHR_texture_transform says."""
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        chosen = attributes.get(f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}")
        if chosen is None or not self._belongs(chosen, count):
            return None
        angle = transform.get("rotation", 0)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        places = self.numbers(chosen) * transform.get("scale", (1, 1)) @ turn + transform.get("offset", (0, 0))
        upwards = places * [1, -1] + [0, 1]
        source = self.header["textures"][texture["index"]]
        number = source.get("extensions", {}).get("EXT_texture_webp", source).get("source", source.get("source"))
        if number is None:  # it is in an extension
            return None
        image = self.header["images"][number]
        uri = image.get("uri", "data:")
        if not uri.startswith("data:"):
            return self.companions.sample(uri, upwards)
        view = image.get("bufferView")
        return self.companions.sample(
            f"image {number}", upwards, lambda: _decode(uri) if view is None else bytes(self._view(view))
        )

    def pose_skin(self, vertices: Floats, attributes: dict[str, int], skin: int, places: dict[int, Floats]) -> Floats:
        """Vertices (N, 3) where the joints of a skeleton put them; the node of the mesh does not count."""
        joints, accessor = self.header["skins"][skin]["joints"], self.header["skins"][skin].get("inverseBindMatrices")
        moved = np.stack([places.get(joint, np.eye(4)) for joint in joints])
        if accessor is not None:
            moved = moved @ self.numbers(accessor).astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
        if not all(self._belongs(attributes[name], len(vertices)) for name in ("JOINTS_0", "WEIGHTS_0")):
            raise ValueError("it has not as many joints as vertices")
        weights, which = self.numbers(attributes["WEIGHTS_0"]).astype(np.float64), self.numbers(attributes["JOINTS_0"])
        _check_indices(which, len(joints), "JOINTS_0")
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        homogeneous = np.pad(vertices, ((0, 0), (0, 1)), constant_values=1)
        placed = np.zeros_like(vertices)
        for weight, joint in zip(weights.T, which.T, strict=True):
            placed += weight[:, None] * np.einsum("nij,nj->ni", moved[joint, :3], homogeneous)
        return placed

    def _view(self, number: int) -> memoryview:
        view = self.header["bufferViews"][number]
        buffer, start = view.get("buffer", 0), view.get("byteOffset", 0)
        data, end = self.buffers[buffer] if self.buffers else b"", start + view["byteLength"]
        return memoryview(_check_length(data, buffer, end))[start:end]

    def numbers(self, accessor: int) -> NDArray[Any]:
        """The numbers (count, components) of an accessor; integers that stand for fractions as these."""
        described = self.header["accessors"][accessor]
        numbers, sparse = self._read(described, described), described.get("sparse")
        if sparse is not None:
            if sparse["count"] > len(numbers):
                refuse(f"accessors[{accessor}].sparse.count", f"at most {len(numbers)}", sparse["count"])
            at = self._read({"count": sparse["count"], "type": "SCALAR"}, sparse["indices"])
            _check_indices(at, len(numbers), f"accessors[{accessor}].sparse.indices")
            numbers[at[:, 0]] = self._read({**described, "count": sparse["count"]}, sparse["values"])
        if described.get("normalized", False) and numbers.dtype.kind in "iu":
            numbers = (numbers / np.float32(np.iinfo(numbers.dtype).max)).clip(-1)
        return numbers

    def _read(self, shape: Json, place: Json) -> NDArray[Any]:
        """A copy of numbers (count, components); zeros where ``place`` names no view."""
        kind = np.dtype(COMPONENT_TYPES[{**shape, **place}["componentType"]])
        count, width = shape["count"], COMPONENTS[shape["type"]]
        if "bufferView" not in place:
            return np.zeros((count, width), kind)
        number, start, size = place["bufferView"], place.get("byteOffset", 0), width * kind.itemsize
        stored, stride = self._view(number), self.header["bufferViews"][number].get("byteStride", size)
        if stride == 0:
            refuse(f"bufferViews[{number}].byteStride", "an integer of at least 1", stride)
        end = start + (stride * (count - 1) + size if count else 0)
        if end > len(stored):
            refuse(f"bufferViews[{number}].byteLength", f"at least {end:,} for an accessor's numbers", len(stored))
        return np.array(np.ndarray((count, width), kind, stored, start, (stride, kind.itemsize)))


def _check_indices(indices: NDArray[Any], count: int, place: str) -> None:
    if indices.dtype.kind not in "iu" or not ((indices >= 0) & (indices < count)).all():
        raise ValueError(f"the numbers of {place} must be indices below {count}")


def _list_triangles(corners: Integers, mode: int) -> Integers:
    """Triangles (F, 3) of a primitive; their orientation does not matter."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    first = corners[:-2] if mode == STRIP else corners[:1]
    return np.stack(np.broadcast_arrays(first, corners[1:-1], corners[2:]), axis=1)
