"""Checks of the header of a glTF file before anything is unpacked: extensions, sizes, the tree of nodes."""

from __future__ import annotations

from collections.abc import Sequence

from .gltf_schema import COMPONENT_TYPES, COMPONENTS, Json
from .soup import MAX_FACES

MAX_NODES = 10_000  # in a GLB
MAX_JSON_BYTES = 2**24  # Python's objects take about thirty times as many
SPARE_BYTES = 2**26  # that a GLB may unpack to beyond its own size
MAX_LEVELS = 20 * MAX_NODES  # the number of ancestors, summed over all nodes
MAX_NODE_DEPTH = 100  # of a GLB's tree of nodes: a node's place is the product of the matrices of all its ancestors

# extensions that leave the geometry and nearly all brightness; others, such as compression, change what numbers mean
_HARMLESS = ("KHR_materials_", "KHR_lights_punctual", "KHR_xmp_json_ld")
_READ = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
_NEVER_READ = ("EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_meshopt_compression")  # required or not
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of primitives; in the last two each index but two makes a triangle


def check_extensions(header: Json) -> None:
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


def check_sizes(header: Json, size: int) -> None:
    """Refuses a file of ``size`` bytes that would unpack to much more: views may overlap, and nodes share meshes."""
    nodes, accessors = header.get("nodes", ()), header.get("accessors", ())
    views = sum(view["byteLength"] for view in header.get("bufferViews", ()))
    unpacked = sum(
        accessor["count"] * int(COMPONENT_TYPES[accessor["componentType"]][-1]) * COMPONENTS[accessor["type"]]
        for accessor in accessors
    )
    meshes = [_count_mesh(mesh, accessors) for mesh in header.get("meshes", ())]
    placed = [meshes[node["mesh"]] for node in nodes if "mesh" in node]
    most_bytes, stored = size + SPARE_BYTES, sum(accessor["count"] for accessor in accessors)
    limits = [("nodes", len(nodes), MAX_NODES), ("bytes in views", views, most_bytes)]
    limits += [("bytes in accessors", unpacked, most_bytes)]
    for where, sizes in (("", meshes), (" in its nodes", placed)):
        most = {"primitives": MAX_NODES, "vertices": max(MAX_FACES, stored), "faces": MAX_FACES}
        limits += [(what + where, sum(size[k] for size in sizes), most[what]) for k, what in enumerate(most)]
    for what, number, limit in limits:
        if number > limit:
            raise ValueError(f"at most {limit:,} {what} are allowed, got {number:,}")


def _count_mesh(mesh: Json, accessors: Sequence[Json]) -> tuple[int, int, int]:
    """The numbers of its primitives, vertices and faces."""
    vertices = faces = 0
    for primitive in mesh["primitives"]:
        count: int = accessors[primitive["attributes"]["POSITION"]]["count"]
        corners: int = accessors[primitive["indices"]]["count"] if "indices" in primitive else count
        vertices += count
        faces += corners if primitive.get("mode") in (STRIP, FAN) else corners // 3
    return len(mesh["primitives"]), vertices, faces


def check_tree(nodes: Sequence[Json]) -> None:
    parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", ())}
    if len(parents) < sum(len(node.get("children", ())) for node in nodes):
        raise ValueError("its nodes are not a tree: one has two parents")
    ancestors = 0
    for child in parents:
        depth = 0
        while child in parents:
            child, depth = parents[child], depth + 1
            if depth > MAX_NODE_DEPTH:
                raise ValueError(f"its nodes are nested in more than {MAX_NODE_DEPTH} levels, or in a circle")
        ancestors += depth
        if ancestors > MAX_LEVELS:
            raise ValueError(f"at most {MAX_LEVELS:,} ancestors are allowed, summed over all nodes")
