"""A small valid file of every format that the package reads."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
import trimesh
from PIL import Image
from scipy.io import savemat

from nablahog import presets
from nablahog.compat.opencv import HOGDescriptor
from nablahog.io.arrays import write_arrays
from tests.io.dpm_models import model
from tests.io.tiny_models import models
from tests.render.mesh_files import CUBE_OFF, TRIANGLE, VERTICES_OBJ, as_bytes, triangle_glb

Kind = Literal["bytes", "text", "json", "zip", "npy", "glb", "mat", "png", "gzip"]
MODES = ("1", "L", "LA", "RGB", "RGBA", "P", "I;16")
FORMATS = ("JPEG", "BMP", "TIFF", "WEBP", "PPM", "TGA", "ICO", "PCX", "SGI", "DDS", "JPEG2000", "GIF")
COMPRESSIONS = ("tiff_lzw", "tiff_adobe_deflate", "jpeg", "packbits")
VIEW = {"azimuth": 317.5, "elevation": 20.1, "distance": 7.5, "theta": -3.5, "azimuth_coarse": 315}
ANNOTATION = b"""<annotation><size><width>500</width><height>375</height><depth>3</depth></size>
<object><name>chair</name><pose>Left</pose><truncated>1</truncated><occluded>0</occluded><difficult>1</difficult>
<bndbox><xmin>1</xmin><ymin>20</ymin><xmax>30.5</xmax><ymax>375</ymax></bndbox></object></annotation>"""
COFF = "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n"
POLYGON = "OFF\n# five corners\n5 1 0\n0 0 0\n2 0 0\n3 1 0\n2 2 0\n0 2 0\n5 0 1 2 3 4\n"
OBJ = f"mtllib a.mtl\no cube\n{VERTICES_OBJ}vt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\nf -1//1 -2//1 -3//1\n"
PLY_HEAD = b"""ply\nformat binary_little_endian 1.0\nelement vertex 4
property float x\nproperty float y\nproperty float z
element face 2\nproperty list uchar int vertex_indices\nend_header\n"""


class Seed(NamedTuple):
    """A valid file.

    Attributes:
        reader: of ``READERS`` in :mod:`.reading`.
        ending: of its name.
        kind: which mutations know its format.
        data: what it holds.
    """

    reader: str
    ending: str
    kind: Kind
    data: bytes


def _images() -> Iterator[Seed]:
    pixels = np.random.default_rng(0).integers(0, 255, (6, 7, 4)).astype(np.uint8)
    colour = Image.fromarray(pixels)

    def saved(picture: Image.Image, name: str, **options: Any) -> bytes:
        file = io.BytesIO()
        picture.save(file, name, **options)
        return file.getvalue()

    for mode in MODES:
        picture = Image.fromarray(pixels[..., 0].astype(np.uint16) * 200) if mode == "I;16" else colour.convert(mode)
        yield Seed("image", ".png", "png", saved(picture, "PNG"))
    picture = colour.convert("RGB")
    frames: dict[str, Any] = {"save_all": True, "append_images": [picture.rotate(90)] * 2}
    for name in FORMATS:
        yield Seed("image", f".{name.lower()}", "bytes", saved(picture, name, **(frames if name == "GIF" else {})))
    for compression in COMPRESSIONS:
        yield Seed("image", ".tif", "bytes", saved(picture, "TIFF", compression=compression))
    yield Seed("image", ".xbm", "text", saved(colour.convert("1"), "XBM"))
    yield Seed("image", ".ppm", "text", b"P3\n# plain\n2 2\n255\n0 1 2 3 4 5\n6 7 8 9 10 11\n")
    yield Seed("image", ".eps", "text", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 7 6\n%%EndComments\n")


def _descriptors(path: Path) -> Iterator[Seed]:
    for spec in (presets.uoctti(), presets.paper(), presets.opencv((16, 16)), presets.skimage()):
        rows, cols = spec.grid(24, 24)
        arrays = {"descriptor": np.full((rows, cols, spec.channels), 0.1, np.float32), "spec": spec.to_json()}
        write_arrays(path, 1, {**arrays, "image_size": (24, 24)}, compressed=True)
        yield Seed("descriptor", ".npz", "zip", path.read_bytes())
        yield Seed("spec", ".json", "json", spec.to_json().encode())
    with path.open("wb") as file:
        np.savez(file, a=np.full((3, 4, 31), 0.1), b=np.array(1), c=np.array("text"))
    yield Seed("descriptor", ".npz", "zip", path.read_bytes())
    for reader, array in (("descriptor", np.full((3, 4, 31), 0.1)), ("template", np.full(3781, 0.1))):
        with path.open("wb") as file:
            np.save(file, array)
        yield Seed(reader, ".npy", "npy", path.read_bytes())
    fields = [(name, object) for name in ("class", "bbox", "viewpoint", "cad_index")]
    objects = np.array([("chair", [1.0, 2, 3, 4], VIEW, 3.0), ("sofa", [1.0, 2, 3, 4], {}, 3.0)], dtype=fields)
    for reader, variables in (
        ("descriptor", {"a": np.full((3, 4, 31), 0.1), "b": "text"}),
        ("template", {"model": model()}),
        ("record", {"record": {"filename": "a.jpg", "objects": objects}}),
    ):
        for packed in (False, True):
            with path.open("wb") as file:
                savemat(file, variables, do_compression=packed)
            yield Seed(reader, ".mat", "mat", path.read_bytes())


def _learned(path: Path) -> Iterator[Seed]:
    for name, each in models().items():
        each.save(path)
        yield Seed(name, ".npz", "zip", path.read_bytes())


def _meshes() -> Iterator[Seed]:
    box = trimesh.creation.box()
    texts = ((".off", CUBE_OFF), (".off", COFF), (".off", POLYGON), (".obj", TRIANGLE), (".obj", OBJ))
    exports = ((".ply", box.export(file_type="ply", encoding="ascii")), (".stl", box.export(file_type="stl_ascii")))
    for ending, text in (*texts, *exports):
        yield Seed("mesh", ending, "text", as_bytes(text))
    for kind in ("stl", "ply"):
        yield Seed("mesh", f".{kind}", "bytes", as_bytes(box.export(file_type=kind)))
    body = np.array([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0], "<f4").tobytes()
    faces = b"\x03" + np.array([0, 1, 2], "<i4").tobytes() + b"\x04" + np.array([0, 1, 2, 3], "<i4").tobytes()
    yield Seed("mesh", ".ply", "bytes", PLY_HEAD + body + faces)
    scene = trimesh.Scene([box, trimesh.creation.box(extents=(1, 2, 3))])
    yield Seed("mesh", ".glb", "glb", as_bytes(scene.export(file_type="glb")))
    yield Seed("mesh", ".glb", "glb", triangle_glb())
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 4), (10, 200, 30)))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    yield Seed("mesh", ".glb", "glb", as_bytes(box.export(file_type="glb")))


def _tables(folder: Path) -> Iterator[Seed]:
    yield Seed("viewpoints", ".csv", "text", b'id,elevation,azimuth,theta\na,20.5,-30,0\nb,-90,370,"1"\n')
    yield Seed("annotation", ".xml", "text", ANNOTATION)
    yield Seed("image_ids", ".txt", "text", b"2008_000003 1\n2008_000007 -1\n2008_000008\n")
    detector = HOGDescriptor((16, 24), (8, 8), (4, 8), (4, 4), 6, _winSigma=2.5, _signedGradient=True)
    detector.setSVMDetector(np.linspace(-0.2, 0.1, detector.getDescriptorSize() + 1))
    kinds: dict[str, Kind] = {".yml": "text", ".xml": "text", ".json": "json", ".yml.gz": "gzip"}
    for ending, kind in kinds.items():
        detector.save(folder / f"file{ending}", "detector")
        yield Seed("storage", ending, kind, (folder / f"file{ending}").read_bytes())


@cache
def seeds() -> list[Seed]:
    """All of them, always in the same order."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        torch.manual_seed(0)
        path = folder / "file"
        return [*_images(), *_descriptors(path), *_learned(path), *_meshes(), *_tables(folder)]
