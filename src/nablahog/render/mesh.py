"""Triangle meshes, from files: vertices V, faces, and per-vertex brightness A."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..inputs.arrays import as_tensor
from ..inputs.numbers import shortened
from ..inputs.tensors import check_dense, check_device, check_values
from ..io.input_file import Readable, input_file
from ..runtime.text import describe_type, to_unicode
from .mesh_file import read_soup
from .soup import Integers, find_distinct

LARGEST_EXTENT = 1e100  # and its reciprocal the smallest: the volume of a box still fits float64
FLAT_AREA = 1e-12
"""Twice the area at or below which a triangle has no area, where the diagonal of the mesh's bounding box is 1."""

FRONTS = {"z": "-y", "y": "+z"}
"""The axis that the front of CAD models usually looks along, by the axis that points up."""

Y_UP = (".obj", ".glb", ".gltf")


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """Triangles with a brightness at each vertex.  Immutable.

    The object's frame is that of PASCAL3D+: z up, the front looks to -y.  Both sides of a triangle are shaded alike, so
    the order of its corners does not matter.

    Arguments may be tensors, or NumPy arrays or lists, of any real numbers, which are converted.

    Attributes:
        vertices: (V, 3), float64, finite; any unit.
        faces: (F, 3), int64 in 0…V-1, at least one.
        brightness: (V,), float64 in 0…1: the gray albedo, which light multiplies.
        from_original: (4, 4), float64: maps points of the original, as they are in the file, to those of the vertices;
            by default the identity.  It is kept through :meth:`normalized` and :func:`load_mesh`.
        name: of its file without the ending, from :func:`load_mesh`; else "".

    Raises:
        ValueError: an array is not as above.

    Source: V and A of Section 3.2, f(V, A, C).

    >>> from nablahog.render import Mesh
    >>> Mesh([[0, 0, 0], [1, 0, 0], [0, 0, 1]], faces=[[0, 1, 2]], brightness=[0.5, 0.5, 0.5]).vertices
    tensor([[0., 0., 0.],
            [1., 0., 0.],
            [0., 0., 1.]], dtype=torch.float64)
    """

    vertices: Tensor
    faces: Tensor
    brightness: Tensor
    from_original: Tensor = field(default_factory=lambda: torch.eye(4, dtype=torch.float64, device="cpu"))
    name: str = ""

    def __post_init__(self) -> None:
        for name in ("vertices", "faces", "brightness", "from_original"):
            object.__setattr__(self, name, _as_numbers(name, getattr(self, name)))
        for name in ("faces", "brightness"):
            check_device(name, getattr(self, name), "vertices", self.vertices)
        count = len(self.vertices)
        _check_shape("vertices", self.vertices, (count, 3))
        _check_shape("faces", self.faces, (len(self.faces), 3))
        _check_shape("brightness", self.brightness, (count,))
        _check_shape("from_original", self.from_original, (4, 4))
        if not len(self.faces):
            raise ValueError("a mesh must have at least one face, got none")
        if not bool(torch.isfinite(self.vertices).all()):
            raise ValueError("vertices must be finite, got NaN or infinite coordinates")
        low, high = int(self.faces.min()), int(self.faces.max())
        if low < 0 or high >= count:
            raise ValueError(f"faces must refer to the vertices 0…{count - 1}, got {low if low < 0 else high}")
        if not bool(((self.brightness >= 0) & (self.brightness <= 1)).all()):  # NaN fails too
            raise ValueError("brightness must lie in 0…1")

    def __repr__(self) -> str:
        """The numbers of vertices and faces."""
        return f"<Mesh {len(self.vertices)} vertices, {len(self.faces)} faces>"

    @property
    def unit(self) -> float:
        """Length of a unit of the vertices in those of the original: the diagonal of a normalised mesh's box."""
        return 1 / float(self.from_original[:3, 0].norm())

    def detach(self) -> Mesh:
        """The mesh without derivatives by it; itself if there are none."""
        if not (self.vertices.requires_grad or self.brightness.requires_grad):
            return self
        return replace(self, vertices=self.vertices.detach(), brightness=self.brightness.detach())

    def normalized(self) -> Mesh:
        """The mesh with its bounding box centred at 0 and of diagonal 1; differentiable in the vertices.

        Raises:
            ValueError: all vertices are one point, or too near or too far apart for products in float64.
        """
        low, high = self.vertices.amin(0), self.vertices.amax(0)
        longest = (high - low).max()
        extent = float(longest.detach())
        if not 1 / LARGEST_EXTENT < extent < LARGEST_EXTENT:
            raise ValueError(
                f"a mesh must have an extent between {1 / LARGEST_EXTENT:g} and {LARGEST_EXTENT:g}, got {extent:g}"
            )
        diagonal = longest * ((high - low) / longest).norm()  # squares of the extents themselves may not fit float64
        middle = low + (high - low) / 2
        moved = self.from_original.clone()
        moved[:3, 3] -= middle.detach().to(moved)
        moved[:3] /= diagonal.detach().to(moved)
        return replace(self, vertices=(self.vertices - middle) / diagonal, from_original=moved)


def check_mesh(mesh: object) -> Mesh:
    """``mesh``; TypeError with what to write, if it is none."""
    if isinstance(mesh, Mesh):
        return mesh
    came = describe_type(mesh, path="nablahog.load_mesh(path)", items="one call for each mesh")
    if hasattr(mesh, "export"):
        came += " of trimesh: write mesh.export('mesh.ply') and nablahog.load_mesh('mesh.ply', up='z'), or 'y'"
    raise TypeError(f"expected a nablahog.Mesh, got {came}")


def _as_numbers(name: str, value: object) -> Tensor:
    """Of a mesh: float64, or int64 of faces, of at least one axis; arrays and lists are copied."""
    what, dtype = ("integers", torch.int64) if name == "faces" else ("real numbers", torch.float64)
    if isinstance(value, Tensor):
        check_dense(name, value)
        check_values(name, value)
    try:
        numbers = value if isinstance(value, Tensor) else as_tensor(name, np.array(value, subok=True))
    except (TypeError, RuntimeError):
        raise ValueError(f"{name} must be a tensor, an array or lists of {what}, got {shortened(value)}") from None
    converted = numbers if numbers.dtype == dtype or numbers.is_complex() else numbers.to(dtype)
    has_fractions = name == "faces" and numbers.is_floating_point() and bool((converted != numbers).any())
    if converted.dtype != dtype or not numbers.dim() or has_fractions:
        got = f"{str(numbers.dtype).removeprefix('torch.')} of shape {tuple(numbers.shape)}"
        raise ValueError(f"{name} must be an array of {what}, got {got}")
    return converted


def _check_shape(name: str, array: Tensor, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, got {tuple(array.shape)}")


def load_mesh(path: Readable, *, up: str | None = None, front: str | None = None) -> Mesh:
    """The mesh in a file, :meth:`~Mesh.normalized`, in the object's frame (z up, front to -y).

    Formats, by the file's ending: OFF (with the colours of COFF), OBJ with MTL, PLY, STL (with Magics' colours), and
    GLB or glTF.  Polygons become triangles, all geometries of a file one mesh, where GLB's nodes and skeletons put
    them.  Triangles of no area, repeated triangles and unused vertices are dropped; vertices at the very same place
    and of the same brightness become one, so that triangles know their neighbours whatever the format.

    Brightness is 0.299 R + 0.587 G + 0.114 B of the file's numbers (no colour management).  The colour is that of the
    texture at the vertex (a mean over 1/64 of the texture), or else of the vertex, or else of the material; in GLB the
    product of these.  Without any colour, it is 0.8.  Transparency is ignored.

    The file is not trusted.  It is refused before it is unpacked if it has too many faces, or if the accessors, nodes
    or textures of a GLB would take much more memory than the file has bytes; the limits are constants of
    :mod:`.soup`, :mod:`.obj_file`, :mod:`.gltf_checks` and :mod:`.companion_files`.  Of the files that it names,
    only those in the same folder or below are read, and ShapeNet's in ``../images``; materials and textures that cannot
    be read are ignored.  Nothing is downloaded.

    Args:
        path: the file, or an :class:`~nablahog.io.input_file.InputFile` of its bytes, which has no files beside it.
        up: which of the file's axes points up: "x", "y" or "z", with a sign or without.  None: "y" for OBJ, GLB and
            glTF, "z" for the others, as these formats are mostly used.
        front: which of the file's axes the front looks along, likewise.  None: "-y" with z up; "+z" with y up, so that
            (x, y, z) becomes (x, -z, y).

    Returns:
        The mesh, on the CPU.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is a folder, of another ending, too big, damaged, or holds no triangle of any area, coordinates
            that are not finite, or faces that refer to vertices that it does not hold; or ``up`` and ``front`` are no
            two axes.

    >>> import tempfile
    >>> from nablahog.render import load_mesh
    >>> with tempfile.NamedTemporaryFile("w", suffix=".off") as file:
    ...     lines = ["OFF", "3 1 0", "0 0 0", "3 0 0", "0 0 4", "3 0 1 2"]
    ...     _ = file.write("\\n".join(lines))
    ...     file.flush()
    ...     mesh = load_mesh(file.name)
    >>> mesh.vertices  # the diagonal of the bounding box, 5, is scaled to 1
    tensor([[-0.3000,  0.0000, -0.4000],
            [ 0.3000,  0.0000, -0.4000],
            [-0.3000,  0.0000,  0.4000]], dtype=torch.float64)
    """
    file = input_file(path)
    turn = np.eye(4)
    turn[:3, :3] = axes(up or ("y" if file.ending in Y_UP else "z"), front)
    vertices, faces, brightness = read_soup(file)
    try:
        arrays = vertices @ turn[:3, :3].T, faces, brightness, turn
        corners, triangles, gray, from_file = map(torch.from_numpy, arrays)
        whole = Mesh(corners, triangles, gray, from_file).normalized()
        tidy = replace(_tidy(whole), name=to_unicode(Path(file.name).stem))
        return tidy.normalized()  # without flat or unused parts, the box may be smaller
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def _tidy(mesh: Mesh) -> Mesh:
    vertices, faces, brightness = mesh.vertices.numpy(), mesh.faces.numpy(), mesh.brightness.numpy()
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > FLAT_AREA]
    if not len(faces):
        raise ValueError("a mesh must have at least one triangle of an area above 0, got none")
    first, vertex = find_distinct(np.column_stack([vertices, brightness]))
    faces = vertex[faces]
    faces = faces[np.sort(find_distinct(np.sort(faces, axis=1))[0])]
    used, flat = np.unique(faces, return_inverse=True)
    corners, faces = torch.from_numpy(vertices[first[used]]), flat.reshape(-1, 3)
    return replace(
        mesh, vertices=corners, faces=torch.from_numpy(faces), brightness=torch.from_numpy(brightness[first[used]])
    )


def axes(up: str, front: str | None = None) -> Integers:
    """The rotation (3, 3) from a file's frame to the object's, z up and front to -y, row by row.

    Args:
        up: the axis of the file that points up: x, y or z, with a sign or without.
        front: the axis that the front looks along; None for that of :data:`FRONTS`.

    Raises:
        ValueError: there is no such axis, none is usual for ``up``, or the two are along one line.

    >>> from nablahog.render.mesh import axes
    >>> axes("y", "+z").tolist()
    [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    """
    upwards = _axis("up", up)
    front = FRONTS.get(up.lstrip("+")) if front is None else front
    if front is None:
        raise ValueError(f"with up {up!r} there is no usual front: give `front`, too, such as '-y'")
    ahead = _axis("front", front)
    right = np.cross(upwards, ahead)
    if not right.any():
        raise ValueError(f"up and front must be two axes that differ, got {up!r} and {front!r}")
    return np.stack([right, -ahead, upwards])


def _axis(name: str, text: str) -> Integers:
    match = re.fullmatch(r"([+-]?)([xyz])", text)
    if match is None:
        raise ValueError(f"{name} must be one of x, y and z, with a sign or without, got {text!r}")
    sign = -1 if match[1] == "-" else 1
    return np.array([sign * (axis == match[2]) for axis in "xyz"])
