"""Nearest neighbours: each patch of the image is the mean of those that photographs have under similar windows.

What Vondrick et al. call the exemplar-LDA baseline of HOGgles (ICCV 2013) averages the images of a database that a
detector trained on the descriptor finds most similar.  Theirs are whole detection windows; here they are windows of 5x5
cells around each cell, by Euclidean distance, so that images of any size can be inverted.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from ...hog.spec import HOGSpec
from ...io.npz import account_of, account_to_text, check_format, naming, read_arrays, text, write_arrays
from ..preimage import Reconstruction, check_descriptor
from ..provenance import digest_of_images
from .windows import Pairs, check_images, mean_of_patches, patch_size, stretched, windows_at_cells, without_search

FORMAT = 1
CELLS = 5  # of the side of a window and of a patch
WINDOWS = 100_000
NEIGHBOURS = 32
_TOGETHER = 256  # windows whose distances to all others are in memory at a time
_ARRAYS = ("format", "spec", "pixels", "sizes", "learning")


@dataclass(frozen=True)
class Learning:
    """What the database was made of.

    Attributes:
        images: the names of the images, sorted.
        sha256: of the images, in this order, hexadecimal.
        windows: the most that are drawn from them.
        seed: of the choice.
    """

    images: tuple[str, ...]
    sha256: str
    windows: int
    seed: int


@dataclass(frozen=True, eq=False)
class NearestWindows:
    """A database of photographs, from which windows and their patches are drawn when they are first needed.

    Attributes:
        spec: the dialect.
        images: (H, W) each, uint8, at least one.
        learning: what they are.

    Raises:
        ValueError: these contradict each other.
    """

    spec: HOGSpec
    images: tuple[Tensor, ...]
    learning: Learning

    def __post_init__(self) -> None:
        if not self.images or len(self.images) != len(self.learning.images):
            names = len(self.learning.images)
            raise ValueError(f"expected at least one image, and one for each of {names} names, got {len(self.images)}")
        for image in self.images:
            if image.dtype != torch.uint8 or image.dim() != 2:
                raise ValueError(f"expected images (H, W) of uint8, got {image.dtype} of {tuple(image.shape)}")
            self.spec.grid(*image.shape)
        if self.learning.windows < 1:
            raise ValueError(f"windows must be at least 1, got {self.learning.windows}")
        if self.learning.seed < 0:
            raise ValueError(f"seed must be at least 0, got {self.learning.seed}")

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was made for."""
        self.spec.check_same(spec, "the database")

    @torch.no_grad()
    def reconstruct(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        image_size: tuple[int, int] | None = None,
        *,
        neighbours: int = NEIGHBOURS,
        progress: Callable[[int, int], None] | None = None,
    ) -> Reconstruction:
        """Images from descriptors, the interface of :func:`nablahog.reconstruct`.  Nothing of it is random.

        Each image is stretched so that its darkest pixel is 0 and its brightest 1; one without contrast is 0.5.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device; computed in float32 on the CPU.
            spec: its dialect, which must be the database's.
            image_size: (height, width); by default whole cells.
            neighbours: whose mean a patch is, at least 1; all windows if there are fewer.
            progress: called with the descriptors done and their number.

        Returns:
            No evaluation of the operator is spent, so the history is empty, (0, B).

        Raises:
            TypeError, ValueError: as :func:`nablahog.reconstruct`; the spec is not the database's.
        """
        began = time.perf_counter()
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        if neighbours < 1:
            raise ValueError(f"neighbours must be at least 1, got {neighbours}")
        count = len(descriptor)
        images = []
        for done, one in enumerate(descriptor.float().cpu()):
            if progress:
                progress(done, count)
            windows = windows_at_cells(one[None], CELLS)
            portions = torch.split(windows.flatten(0, 2), _TOGETHER)
            patches = torch.cat([self._expected(some, neighbours) for some in portions])
            images.append(stretched(mean_of_patches(patches.view(*windows.shape[:3], -1), spec, CELLS, size)))
        if progress:
            progress(count, count)
        return without_search(torch.cat(images), descriptor, spec, "windows are done", began)

    def _expected(self, windows: Tensor, neighbours: int) -> Tensor:
        """The mean patch (N, pixels) of the windows nearest to each of (N, n)."""
        known, halved, patches = self._database
        similar = windows @ known.T - halved  # ½‖x‖² short of -½‖x - y‖²
        nearest = similar.topk(min(neighbours, len(known)), dim=1).indices
        total = torch.zeros(len(windows), patches.shape[1])
        for each in nearest.T:
            total += patches[each]
        return total / (255 * nearest.shape[1])

    @cached_property
    def _database(self) -> tuple[Tensor, Tensor, Tensor]:
        """Windows (N, n), half their squared lengths (N,), and patches (N, pixels), uint8."""
        images = [image.float() / 255 for image in self.images]
        rng = np.random.default_rng(self.learning.seed)
        pairs = Pairs(images, self.spec, CELLS, self.learning.windows, rng)
        windows = torch.empty(len(pairs), CELLS * CELLS * self.spec.channels)
        patches = torch.empty(len(pairs), math.prod(patch_size(self.spec, CELLS)), dtype=torch.uint8)
        first = 0
        for some, of in pairs:
            last = first + len(some)
            windows[first:last], patches[first:last] = some, (of * 255).round().byte()
            first = last
        return windows, windows.square().sum(1) / 2, patches

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to the file ``path``, whatever its name ends in.  The file is replaced whole or not at all.

        It is a compressed .npz archive of the arrays ``format`` (1), ``spec`` (its JSON), ``pixels`` (of all images,
        one after another, uint8), ``sizes`` (N, 2) and ``learning`` (JSON).

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {
            "spec": self.spec.to_json(),
            "pixels": torch.cat([image.flatten() for image in self.images]).numpy(),
            "sizes": [tuple(image.shape) for image in self.images],
            "learning": account_to_text(self.learning),
        }
        write_arrays(path, FORMAT, arrays, compressed=True)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> NearestWindows:
        """The database that :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, or its arrays
                contradict each other.
        """
        arrays = read_arrays(path, "database of windows", _ARRAYS)
        with naming(path):
            check_format(arrays, "database", FORMAT)
            pixels, sizes = arrays["pixels"], arrays["sizes"]
            if pixels.dtype != np.uint8 or sizes.dtype.kind not in "iu" or sizes.ndim != 2 or sizes.shape[1] != 2:
                raise ValueError(
                    f"expected pixels of uint8 and integer sizes (N, 2), got {pixels.dtype} and {sizes.dtype} of shape "
                    f"{sizes.shape}"
                )
            shapes = [(int(height), int(width)) for height, width in sizes.tolist()]
            if min(map(min, shapes), default=0) < 1 or pixels.shape != (sum(map(math.prod, shapes)),):
                raise ValueError(f"the sizes of the images must make {pixels.size} pixels")
            parts = torch.split(torch.from_numpy(pixels), [math.prod(shape) for shape in shapes])
            images = tuple(part.view(shape) for part, shape in zip(parts, shapes, strict=True))
            spec, learning = (text(arrays, name) for name in ("spec", "learning"))
            return cls(HOGSpec.from_json(spec), images, account_of(Learning, learning))


def learn_nearest(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    windows: int = WINDOWS,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> NearestWindows:
    """Makes a database of photographs.

    Args:
        images: (H, W) each, float32 in 0…1, by name; kept in 256 gray levels.
        spec: the dialect.
        windows: the most to search among; if there are more, so many of them, at random.
        seed: of everything random.
        progress: called with the images done, their number and what is being done.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; ``windows`` is below 1.
    """
    names = check_images(images, spec)
    progress(0, len(names), "keeping the images")
    kept = tuple((images[name] * 255).round().byte() for name in names)
    progress(len(names), len(names), "")
    return NearestWindows(spec, kept, Learning(tuple(names), digest_of_images(names, images), windows, seed))
