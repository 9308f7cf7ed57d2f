"""Specs and images that several test files use."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from nablahog.hog import FourBlockNorm, GlobalNorm, HOGSpec, presets

DOUBLE = torch.float64

PRESETS: dict[str, Callable[..., HOGSpec]] = {
    "paper": presets.paper,
    "paper-robust": lambda cell_size=8: presets.paper(cell_size, global_form="robust"),
    "uoctti": presets.uoctti,
    "uoctti-hard": lambda cell_size=8: presets.uoctti(cell_size, vote="hard"),
    "aubry": presets.aubry,
}


def spec(**changes: Any) -> HOGSpec:
    """The paper's spec at cells of 4, with some fields changed; a spec free to be none of the presets."""
    return dataclasses.replace(presets.paper(4), name="test", **changes)


# Every value of every field at least once, in combinations the presets do not have.
UNUSUAL: dict[str, HOGSpec] = {
    "replicate": spec(border="replicate", cell_size=(3, 5), partial_cells="ceil"),
    "zero-largest": spec(border="zero", colour="largest", partial_cells="round", value_range=255.0),
    "ignore-robust": spec(border="ignore", cell_size=(2, 3), normalizer=GlobalNorm(0.1, "robust")),
    "signed-odd": spec(signed=True, bins=7, bin_offset=0.25),
    "three-bins": spec(bins=3, bin_offset=0.0, cell_size=(1, 1)),
    "hard-unsigned": spec(vote="hard", bin_offset=0.5, cell_size=(5, 4)),
    "hard-signed-global": spec(vote="hard", signed=True, bins=8, partial_cells="ceil"),
    "four-block-reflect": spec(
        signed=True, bins=12, bin_offset=0.5, colour="largest", normalizer=FourBlockNorm(epsilon=0.5, clip=0.35)
    ),
    **{
        "-".join(parts): dataclasses.replace(presets.uoctti(4), normalizer=FourBlockNorm(0.3, 0.25, parts))
        for parts in (("directed", "texture"), ("undirected", "texture"))
    },
}

SPECS: dict[str, HOGSpec] = {**{name: make(4) for name, make in PRESETS.items()}, **UNUSUAL}


def noise(*shape: int, seed: int = 0, dtype: torch.dtype = DOUBLE) -> Tensor:
    """A continuous random image: no kink has a chance."""
    return torch.rand(shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


def integers(*shape: int, seed: int = 0, dtype: torch.dtype = DOUBLE, levels: int = 256) -> Tensor:
    """A random 8-bit image in 0…1, of few levels if you want many ties."""
    generator = torch.Generator().manual_seed(seed)
    return (torch.randint(levels, shape, generator=generator) * (255 // (levels - 1))).to(dtype) / 255
