"""A small valid file of every format that the package reads."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import trimesh
from PIL import Image
from scipy.io import savemat

from nablahog import presets
from nablahog.compat.opencv import HOGDescriptor
from nablahog.io.npz import write_arrays
from nablahog.paper.exemplar_views import ExemplarViews
from tests.io.dpm_models import model
from tests.io.tiny_models import models
from tests.paper.test_pascal3d import COARSE, FINE
from tests.paper.test_voc import ANNOTATION
from tests.render.mesh_files import CUBE_OFF, TRIANGLE, VERTICES_OBJ, as_bytes, triangle_glb

Kind = Literal["bytes", "text", "json", "zip", "npy", "glb", "mat", "png", "gzip"]


@dataclass(frozen=True)
class Seed:
    """A valid file.

    Attributes:
        reader: of :data:`.file_server.READERS`.
        ending: of its name.
        kind: which mutations know its format.
        data: what it holds.
    """

    reader: str
    ending: str
    kind: Kind
    data: bytes


def _images() -> Iterator[tuple[str, Seed]]:
    pixels = np.random.default_rng(0).integers(0, 255, (6, 7, 4)).astype(np.uint8)
    colour = Image.fromarray(pixels)
    for mode in ("1", "L", "LA", "RGB", "RGBA", "P", "I;16"):
        picture = Image.fromarray(pixels[..., 0].astype(np.uint16) * 200) if mode == "I;16" else colour.convert(mode)
        yield f"png {mode}", Seed("image", ".png", "png", _saved(picture, "PNG"))
    for name in ("JPEG", "BMP", "TIFF", "WEBP", "PPM", "TGA", "ICO", "PCX", "SGI", "DDS", "JPEG2000", "GIF"):
        picture = colour.convert("RGB")
        more: dict[str, Any] = {"save_all": True, "append_images": [picture.rotate(90)] * 2} if name == "GIF" else {}
        yield name.lower(), Seed("image", f".{name.lower()}", "bytes", _saved(picture, name, **more))
    for compression in ("tiff_lzw", "tiff_adobe_deflate", "jpeg", "packbits"):
        yield (
            compression,
            Seed("image", ".tif", "bytes", _saved(colour.convert("RGB"), "TIFF", compression=compression)),
        )
    yield "xbm", Seed("image", ".xbm", "text", _saved(colour.convert("1"), "XBM"))
    yield "plain ppm", Seed("image", ".ppm", "text", b"P3\n# plain\n2 2\n255\n0 1 2 3 4 5\n6 7 8 9 10 11\n")
    yield "eps", Seed("image", ".eps", "text", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 7 6\n%%EndComments\n")


def _saved(picture: Image.Image, name: str, **options: Any) -> bytes:
    file = io.BytesIO()
    picture.save(file, name, **options)
    return file.getvalue()


def _descriptors(folder: Path) -> Iterator[tuple[str, Seed]]:
    path = folder / "file"
    for spec in (presets.uoctti(), presets.paper(), presets.opencv((16, 16)), presets.skimage()):
        rows, cols = spec.grid(24, 24)
        arrays = {"descriptor": np.full((rows, cols, spec.channels), 0.1, np.float32), "spec": spec.to_json()}
        write_arrays(path, 1, {**arrays, "image_size": (24, 24)}, compressed=True)
        yield f"descriptor {spec.name}", Seed("descriptor", ".npz", "zip", path.read_bytes())
        yield f"spec {spec.name}", Seed("spec", ".json", "json", spec.to_json().encode())
    cells = np.full((3, 4, 31), 0.1)
    np.savez(path.with_suffix(".npz"), a=cells, b=np.array(1), c=np.array("text"))
    yield "arrays", Seed("descriptor", ".npz", "zip", path.with_suffix(".npz").read_bytes())
    np.save(path.with_suffix(".npy"), cells)
    yield "npy", Seed("descriptor", ".npy", "npy", path.with_suffix(".npy").read_bytes())
    np.save(path.with_suffix(".npy"), np.full(3781, 0.1))
    yield "template", Seed("template", ".npy", "npy", path.with_suffix(".npy").read_bytes())


def _matlab(folder: Path) -> Iterator[tuple[str, Seed]]:
    path = folder / "file.mat"
    objects = [(each, [1.0, 2, 3, 4], view, 3.0) for each, view in (("chair", FINE), ("sofa", COARSE))]
    fields = [(name, object) for name in ("class", "bbox", "viewpoint", "cad_index")]
    for name, reader, variables in (
        ("array", "descriptor", {"a": np.full((3, 4, 31), 0.1), "b": "text"}),
        ("model", "template", {"model": model()}),
        ("record", "record", {"record": {"filename": "a.jpg", "objects": np.array(objects, dtype=fields)}}),
    ):
        for packed in (False, True):
            savemat(path, variables, do_compression=packed)
            yield f"mat {name}{' packed' if packed else ''}", Seed(reader, ".mat", "mat", path.read_bytes())


def _learned(folder: Path) -> Iterator[tuple[str, Seed]]:
    path = folder / "file"
    few = {
        "weights": torch.rand(3, 2, 2, 31).half().float(),
        "scale": torch.ones(3),
        "offset": torch.zeros(3),
        "level": torch.tensor([0, 1, 2]),
        "positions": torch.ones(3, 2, dtype=torch.int64),
        "first": torch.tensor([0, 1, 3]),
        "boxes": torch.rand(2, 4),
        "viewpoints": torch.rand(2, 2),
    }
    for name, each in {**models(), "views": ExemplarViews(**few)}.items():
        each.save(path)
        yield name, Seed(name, ".npz", "zip", path.read_bytes())


def _meshes() -> Iterator[tuple[str, Seed]]:
    box = trimesh.creation.box()
    coff = "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n"
    polygon = "OFF\n# five corners\n5 1 0\n0 0 0\n2 0 0\n3 1 0\n2 2 0\n0 2 0\n5 0 1 2 3 4\n"
    obj = (
        "mtllib a.mtl\no cube\n"
        + VERTICES_OBJ
        + "vt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\nf -1//1 -2//1 -3//1\n"
    )
    for name, ending, text in (
        ("off", ".off", CUBE_OFF),
        ("coff", ".off", coff),
        ("off polygon", ".off", polygon),
        ("obj", ".obj", TRIANGLE),
        ("obj relative", ".obj", obj),
        ("ply text", ".ply", box.export(file_type="ply", encoding="ascii")),
        ("stl text", ".stl", box.export(file_type="stl_ascii")),
    ):
        yield name, Seed("mesh", ending, "text", as_bytes(text))
    yield "stl", Seed("mesh", ".stl", "bytes", as_bytes(box.export(file_type="stl")))
    yield "ply", Seed("mesh", ".ply", "bytes", as_bytes(box.export(file_type="ply")))
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\n"
    head += b"property float x\nproperty float y\nproperty float z\n"
    head += b"element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    body = np.array([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0], "<f4").tobytes()
    faces = b"\x03" + np.array([0, 1, 2], "<i4").tobytes() + b"\x04" + np.array([0, 1, 2, 3], "<i4").tobytes()
    yield "ply polygons", Seed("mesh", ".ply", "bytes", head + body + faces)
    scene = trimesh.Scene([box, trimesh.creation.box(extents=(1, 2, 3))])
    yield "glb", Seed("mesh", ".glb", "glb", as_bytes(scene.export(file_type="glb")))
    yield "glb triangle", Seed("mesh", ".glb", "glb", triangle_glb())
    texture = Image.new("RGB", (4, 4), (10, 200, 30))
    box.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((len(box.vertices), 2)), material=trimesh.visual.material.PBRMaterial(baseColorTexture=texture)
    )
    yield "glb texture", Seed("mesh", ".glb", "glb", as_bytes(box.export(file_type="glb")))


def _tables() -> Iterator[tuple[str, Seed]]:
    yield "csv", Seed("viewpoints", ".csv", "text", b'id,elevation,azimuth,theta\na,20.5,-30,0\nb,-90,370,"1"\n')
    yield "xml", Seed("annotation", ".xml", "text", ANNOTATION.encode())
    yield "image ids", Seed("image_ids", ".txt", "text", b"2008_000003 1\n2008_000007 -1\n2008_000008\n")


def _storages(folder: Path) -> Iterator[tuple[str, Seed]]:
    descriptor = HOGDescriptor((16, 24), (8, 8), (4, 8), (4, 4), 6, _winSigma=2.5, _signedGradient=True)
    descriptor.setSVMDetector(np.linspace(-0.2, 0.1, descriptor.getDescriptorSize() + 1))
    kinds: dict[str, Kind] = {".yml": "text", ".xml": "text", ".json": "json", ".yml.gz": "gzip"}
    for ending, kind in kinds.items():
        path = folder / f"file{ending}"
        descriptor.save(path, "detector")
        yield f"storage {ending}", Seed("storage", ending, kind, path.read_bytes())


@cache
def seeds() -> dict[str, Seed]:
    """All of them by name."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        torch.manual_seed(0)
        parts = (
            *(_images(), _descriptors(folder), _matlab(folder), _learned(folder)),
            *(_meshes(), _tables(), _storages(folder)),
        )
        return {name: seed for part in parts for name, seed in part}
