"""The zoo: one dialect of every kind, and images that suit it, for tests of what holds for all.

Presets, and normalisers whose arguments all have defaults, are in it by themselves; others are listed in ``UNUSUAL``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

from nablahog.hog import (
    BilinearCells,
    BlockCells,
    BlockNorm,
    BoxCells,
    CellNorm,
    FourBlockNorm,
    GlobalNorm,
    HOGSpec,
    presets,
)
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.hog.normalizers import Normalizer
from nablahog.hog.normalizers.four_block import PARTS

DOUBLE = torch.float64


def sized(s: HOGSpec, cell_size: int | tuple[int, int]) -> HOGSpec:
    """The dialect with cells of another size; blocks have as many, and cells lie in as many blocks, as before."""
    cell = (cell_size, cell_size) if isinstance(cell_size, int) else cell_size
    pooling = s.pooling
    if isinstance(pooling, BlockCells):
        (block, step), old = (pooling.block, pooling.step), s.cell_size
        pooling = dataclasses.replace(
            pooling,
            block=(block[0] // old[0] * cell[0], block[1] // old[1] * cell[1]),
            step=(max(step[0] * cell[0] // old[0], 1), max(step[1] * cell[1] // old[1], 1)),
        )
    return dataclasses.replace(s, cell_size=cell, pooling=pooling)


def _any_size(s: HOGSpec) -> Callable[..., HOGSpec]:
    return lambda cell_size=8: sized(s, cell_size)


# What one dialect is: each preset, and the variants that differ in more than a number.
PRESETS: dict[str, Callable[..., HOGSpec]] = {
    **{name: _any_size(default) for name, default in DEFAULT_SPECS.items()},
    "paper-robust": lambda cell_size=8: presets.paper(cell_size, global_form="robust"),
    "uoctti-hard": lambda cell_size=8: presets.uoctti(cell_size, vote="hard"),
    "vlfeat-bilinear": _any_size(presets.vlfeat(bilinear_orientations=True)),
    "vlfeat-dalaltriggs": _any_size(presets.vlfeat("dalaltriggs", orientations=8)),
    "vlfeat-dalaltriggs-bilinear": _any_size(presets.vlfeat("dalaltriggs", bilinear_orientations=True)),
    "cnn-hogb": _any_size(presets.cnn_hog(bilinear=True)),
    "skimage-2x2": _any_size(presets.skimage(cells_per_block=(2, 2))),
    "skimage-colour": _any_size(presets.skimage(8, cells_per_block=(1, 2), block_norm="L1", channel_axis=-1)),
    "skimage-root": _any_size(presets.skimage(7, (8, 8), (2, 1), "L1-sqrt", transform_sqrt=True)),
    "opencv-signed": _any_size(presets.opencv(nbins=12, gamma=False, signed=True)),
    "maskfeat-plain": _any_size(presets.maskfeat(gaussian_window=0)),
    "maskfeat-window": _any_size(presets.maskfeat(gaussian_window=4)),
}


def spec(**changes: Any) -> HOGSpec:
    """The paper's spec at cells of 4, with some fields changed; a spec free to be none of the presets."""
    return dataclasses.replace(presets.paper(4), name="test", **changes)


def _four(bins: int = 8, **changes: Any) -> dict[str, Any]:
    """Fields of a spec with signed bins and a four-block normaliser."""
    return {"signed": True, "bins": bins, "normalizer": FourBlockNorm(**changes)}


# Every value of every field at least once, in combinations the presets do not have.
UNUSUAL: dict[str, HOGSpec] = {
    "replicate": spec(border="replicate", cell_size=(3, 5), partial_cells="ceil"),
    "zero-largest": spec(border="zero", colour="largest", partial_cells="round", value_range=255.0),
    "ignore-robust": spec(border="ignore", cell_size=(2, 3), normalizer=GlobalNorm(0.1, "robust")),
    "signed-odd": spec(signed=True, bins=7, bin_offset=0.25),
    "three-bins": spec(bins=3, bin_offset=0.0, cell_size=(1, 1)),
    "hard-unsigned": spec(vote="hard", bin_offset=0.5, cell_size=(5, 4)),
    "hard-signed-global": spec(vote="hard", signed=True, bins=8, partial_cells="ceil"),
    "four-block-reflect": spec(bin_offset=0.5, colour="largest", **_four(12, epsilon=0.5, clip=0.35)),
    **{
        "-".join(parts): dataclasses.replace(presets.uoctti(4), normalizer=FourBlockNorm(0.3, 0.25, parts))
        for parts in (("directed", "texture"), ("undirected", "texture"))
    },
    # gradients
    "extrapolate": spec(border="extrapolate", colour="largest", partial_cells="round", cell_size=(3, 4)),
    "gray-border-root": spec(border="gray", gamma="sqrt", value_range=255.0, bins=5),
    "root-separate": spec(gamma="sqrt", colour="separate", border="replicate", cell_size=(4, 3)),
    "sobel": spec(mask="sobel", border="zero", cell_size=(4, 3), partial_cells="ceil"),
    "sobel-separate": spec(mask="sobel", colour="separate", border="extrapolate", **_four(epsilon=0.1)),
    "sobel-ignore": spec(mask="sobel", border="ignore", colour="largest", bins=6, normalizer=CellNorm(0.1)),
    "ties-opencv": spec(colour="largest", colour_ties="opencv", cell_size=(3, 3), vote="hard"),
    "ties-dlib": spec(colour="largest", colour_ties="dlib", cell_size=(3, 3), border="ignore"),
    # votes
    "counterclockwise": spec(counterclockwise=True, bin_offset=0.25, signed=True, bins=10),
    "counterclockwise-hard": spec(counterclockwise=True, vote="hard", bins=7, bin_offset=2.75),
    "upper": spec(vote="hard", boundary="upper", bin_offset=1.25, bins=5, cell_size=(3, 4)),
    "upper-signed": spec(vote="hard", boundary="upper", bin_offset=3.3, colour="largest", **_four(8, epsilon=0.2)),
    "upper-counterclockwise": spec(vote="hard", boundary="upper", counterclockwise=True, signed=True, bins=10),
    "derivative": spec(vote="hard", derivative="linear", colour="largest", **_four(8, epsilon=0.2)),
    "derivative-upper": spec(vote="hard", derivative="linear", boundary="upper", bins=7, counterclockwise=True),
    "four-decimals": spec(vote="hard", directions="four-decimals", bin_offset=0.0, bins=12, signed=True),
    "angle-opencv": spec(angle="opencv", bin_offset=0.25, bins=5, border="ignore"),
    "angle-opencv-signed": spec(angle="opencv", signed=True, bins=7, bin_offset=2.5),
    "angle-vlfeat": spec(angle="vlfeat", bins=12, signed=True, bin_offset=0.0, normalizer=CellNorm(0.5)),
    # pooling
    "repeat": spec(pooling=BilinearCells("repeat"), partial_cells="ceil", cell_size=(4, 3)),
    "repeat-ignore": spec(pooling=BilinearCells("repeat", 1.5), border="ignore", partial_cells="round"),
    "drop-ignore": spec(pooling=BilinearCells("drop"), border="ignore", cell_size=(3, 4)),
    "drop-gain": spec(pooling=BilinearCells("drop", 0.75), cell_size=(4, 3), partial_cells="round"),
    "box": spec(pooling=BoxCells(), cell_size=(3, 4), partial_cells="ceil", border="ignore"),
    "box-mean": spec(pooling=BoxCells(mean=True), cell_size=(4, 2), normalizer=GlobalNorm(0.1, "robust")),
    "box-window": spec(
        pooling=BoxCells(mean=True, window=3), cell_size=(3, 2), partial_cells="round", colour="largest"
    ),
    "block": spec(
        pooling=BlockCells((4, 6), (3, 2), 1.5),
        cell_size=(2, 3),
        border="ignore",
        signed=True,
        bins=6,
        normalizer=BlockNorm((2, 2), (2, 2), "L1", 0.1),
        layout="opencv-vector",
    ),
    # normalisers
    "blocks-L2": spec(normalizer=BlockNorm((2, 2), (1, 2), "L2", 0.2), cell_size=(2, 2)),
    "blocks-L2-added": spec(
        normalizer=BlockNorm((1, 2), (2, 1), "L2", 0.2, epsilon_outside_root=True), colour="separate"
    ),
    "blocks-L1-sqrt": spec(normalizer=BlockNorm((2, 1), (1, 1), "L1-sqrt", 0.2), pooling=BoxCells(), vote="hard"),
    "blocks-Hys": spec(
        normalizer=BlockNorm((2, 2), epsilon=0.3, epsilon_again=0.1, epsilon_outside_root=True, clip=0.1)
    ),
    "cells-separate": spec(normalizer=CellNorm(2.0), colour="separate", layout="colour-planes"),
    "missing-floor": spec(**_four(epsilon=0.7, floor=True, outside="missing", parts=PARTS, texture="dpm")),
    "drop-blocks": spec(cell_size=(2, 2), **_four(outside="drop", parts=("undirected", "texture", "blocks"))),
    "unsigned-four-block": spec(bins=7, normalizer=FourBlockNorm(0.1, 0.3, ("undirected", "texture", "zero"))),
    "unsigned-missing": spec(
        bins=5,
        vote="hard",
        normalizer=FourBlockNorm(0.1, parts=("undirected", "blocks"), outside="missing", floor=True),
    ),
}


def fits(s: HOGSpec, *shape: int) -> bool:
    """Whether images of the shape (…, channels, height, width) have a descriptor."""
    try:
        s.grid(*shape[-2:])
    except ValueError:
        return False
    return s.colour != "separate" or shape[-3] in (1, 3)


def _with_defaults(kind: type[Normalizer]) -> HOGSpec:
    """A spec with a normaliser's defaults, in unsigned bins if these go with it."""
    try:
        return spec(normalizer=kind())
    except ValueError:
        return spec(signed=True, bins=8, normalizer=kind())


def _some_cells_left(make: Callable[..., HOGSpec]) -> HOGSpec:
    """The dialect with the largest cells, of up to 4 pixels, of which small images have some.

    Only dialects that leave the outermost cells out, or have large blocks, need smaller ones.
    """
    specs = [make(cell_size) for cell_size in (4, 3, 2)]
    return next(s for s in specs if all(fits(s, 3, *size) for size in ((14, 11), (8, 8))))


NORMALIZERS: dict[str, HOGSpec] = {
    f"default-{kind}": _with_defaults(part)
    for kind, part in Normalizer.kinds.items()
    if part.__module__.startswith("nablahog.")
    and all(constant.default is not dataclasses.MISSING for constant in dataclasses.fields(part))
}
"""Each normaliser of the package with its defaults, if all its constants have one."""
SPECS: dict[str, HOGSpec] = {
    **{name: _some_cells_left(make) for name, make in PRESETS.items()},
    **NORMALIZERS,
    **UNUSUAL,
}


def rounding(s: HOGSpec) -> float:
    """What two float64 evaluations may differ by: angles of libraries are float32 whatever the image."""
    return 1e-12 if s.angle == "exact" else 1e-5


def noise(*shape: int, seed: int = 0, dtype: torch.dtype = DOUBLE) -> Tensor:
    """A continuous random image: no kink has a chance."""
    return torch.rand(shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


def integers(*shape: int, seed: int = 0, dtype: torch.dtype = DOUBLE, levels: int = 256) -> Tensor:
    """A random 8-bit image in 0…1, of few levels if you want many ties."""
    generator = torch.Generator().manual_seed(seed)
    return (torch.randint(levels, shape, generator=generator) * (255 // (levels - 1))).to(dtype) / 255


def bytes_of(height: int, width: int) -> Tensor:
    """Two images of uint8 and three colours; the second one of few levels."""
    x = torch.randint(256, (2, 3, height, width), dtype=torch.uint8, generator=torch.Generator().manual_seed(1))
    x[1] //= 32
    return x


def waves(like: Tensor, last: float = 40) -> Tensor:
    """A fixed cotangent or tangent."""
    return torch.linspace(0, last, like.numel(), dtype=DOUBLE).cos().view(like.shape).to(like)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """So many of PyTorch."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
