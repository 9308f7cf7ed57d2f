"""Common ground: the same for descriptors of any shape."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from nablahog.dialects.common_form import (
    DIRECTIONS,
    Channels,
    Entries,
    Orientations,
    common_region,
    region,
    resampling_weights,
    same_channels,
)
from nablahog.dialects.describer import Describer
from nablahog.hog import BlockNorm, HOGSpec, hog, presets
from nablahog.hog.box import Box
from tests.hog.zoo import SPECS as ZOO
from tests.hog.zoo import fits, integers

from .common import CAT, SPECS

IMAGE = (integers(1, 3, 26, 31, seed=1)[0] * 255).round().to(torch.uint8)
GROUND = Orientations()


def _covers(spec: HOGSpec) -> bool:
    """Whether each cell lies in some block."""
    scheme = spec.normalizer
    return not isinstance(scheme, BlockNorm) or all(s <= b for s, b in zip(scheme.step, scheme.block, strict=True))


@pytest.mark.parametrize("name", [name for name, spec in ZOO.items() if fits(spec, 3, 26, 31) and _covers(spec)])
def test_every_hog_has_its_cells_there(name: str) -> None:
    spec, describer = ZOO[name], Describer(IMAGE)
    reduced = GROUND.reduced(spec)
    ((_, descriptor),) = describer.descriptors([reduced])
    result = GROUND.entries(descriptor, reduced, describer.size)
    assert result.region == region(spec, describer.size)
    assert result.values.shape[2] == DIRECTIONS
    assert torch.isfinite(result.values).all()
    assert result.values.max() > 0
    computed = describer.computed(reduced)
    ((_, descriptor),) = describer.descriptors([computed])
    more = GROUND.entries(descriptor, computed, describer.size)
    torch.testing.assert_close(more.within(result.region), result.values.flatten())


def test_descriptors_are_those_of_the_operator() -> None:
    result = dict(Describer(CAT).descriptors(SPECS.values()))
    assert len(result) == len(SPECS)
    for name, spec in SPECS.items():
        assert torch.equal(result[spec], hog(CAT.unsqueeze(0), spec, backend="torch")), name


@pytest.mark.parametrize("name", SPECS)
@pytest.mark.parametrize("degrees", [0, 45, 90, 135])
def test_an_edge_has_one_direction_in_all(name: str, degrees: int) -> None:
    """Rows of the picture are y, which grows downwards, as angles do."""
    y, x = torch.meshgrid(torch.arange(48.0), torch.arange(48.0), indexing="ij")
    along = x * math.cos(math.radians(degrees)) + y * math.sin(math.radians(degrees))
    ramp = 127.5 + 100 * torch.sin(along / 12)
    image = ramp.round().to(torch.uint8).expand(3, 48, 48)
    describer = Describer(image)
    spec = GROUND.reduced(SPECS[name])
    ((_, descriptor),) = describer.descriptors([spec])
    inner = GROUND.entries(descriptor, spec, describer.size).within(Box(2, 2, 4, 4)).reshape(-1, DIRECTIONS).sum(dim=0)
    turn = torch.arange(DIRECTIONS) * (2 * math.pi / DIRECTIONS)  # twice the angle, since it is unsigned
    mean = torch.atan2((inner * turn.sin()).sum(), (inner * turn.cos()).sum()).rad2deg().item() / 2
    assert abs((mean - degrees + 90) % 180 - 90) <= 10.5  # ties may go to one side of the edge


def test_nine_bins_keep_their_entries() -> None:
    for offset in (0.0, 0.5):
        spec = replace(presets.paper(8), bin_offset=offset)
        weights = resampling_weights(spec)
        own = weights[int(2 * offset) :: 2]
        torch.testing.assert_close(own, torch.eye(9, dtype=torch.float64))
        between = weights[1 - int(2 * offset) :: 2]
        torch.testing.assert_close(between.sum(dim=1), torch.ones(9, dtype=torch.float64))
        assert sorted(between[0].tolist())[-3:] == pytest.approx([0, 0.5, 0.5])


def test_opposite_bins_are_added() -> None:
    weights = resampling_weights(presets.vlfeat())
    assert weights.shape == (DIRECTIONS, 18)
    torch.testing.assert_close(weights[:, :9], weights[:, 9:])
    torch.testing.assert_close(weights[::2, :9], torch.eye(9, dtype=torch.float64))
    mirrored = resampling_weights(replace(presets.vlfeat(), counterclockwise=True))
    torch.testing.assert_close(mirrored[2, 8], torch.tensor(1.0, dtype=torch.float64))


def test_contrast_insensitive_channels_count() -> None:
    parts = {name: GROUND.reduced(spec).normalizer for name, spec in SPECS.items()}
    assert parts["dpm"].parts == parts["cnn_hog"].parts == ("undirected",)
    assert GROUND.reduced(presets.vlfeat("dalaltriggs")).normalizer.parts == ("blocks",)
    assert GROUND.reduced(SPECS["opencv"]) == SPECS["opencv"]


def test_regions_are_x_before_y() -> None:
    """A region of a descriptor of 4 rows and 6 columns, whose first cell is the image's second in each direction."""
    entries = Entries(torch.arange(24.0).reshape(4, 6, 1), 1, 1)
    assert entries.region == Box(1, 1, 7, 5)
    assert entries.within(Box(2, 3, 5, 4)).tolist() == [13, 14, 15]
    assert common_region([entries.region, Box(3, 0, 9, 3)]) == Box(3, 1, 7, 3)


def test_cells_of_presets() -> None:
    size = (48, 74)  # 6x9.25 cells
    whole = Box(0, 0, 9, 6)
    dropped = Box(1, 1, 8, 5)
    result = {name: region(spec, size) for name, spec in SPECS.items()}
    assert {name for name, cells in result.items() if cells == dropped} == {"dpm", "dlib", "seeing3d"}
    assert all(result[name] == whole for name in result.keys() - {"dpm", "dlib", "seeing3d"})
    assert region(SPECS["vlfeat"], (48, 76)) == Box(0, 0, 10, 6)
    assert common_region([whole, dropped]) == dropped
    assert common_region([Box(0, 0, 2, 5), Box(2, 0, 4, 5)]) is None


def _channels(a: HOGSpec, b: HOGSpec) -> tuple[str, ...] | None:
    result = same_channels(a, b)
    assert result == same_channels(b, a)
    return result and result.parts


def test_channels_with_the_same_meaning() -> None:
    vlfeat, dpm = SPECS["vlfeat"], SPECS["dpm"]
    assert _channels(vlfeat, dpm) == ("directed", "undirected", "texture")
    assert _channels(dpm, SPECS["cnn_hog"]) == ("directed", "undirected")
    assert _channels(SPECS["aubry"], SPECS["seeing3d"]) == ("undirected",)  # of signed bins, and of others
    assert _channels(vlfeat, presets.vlfeat("dalaltriggs")) is None
    assert _channels(vlfeat, SPECS["skimage"]) is None
    assert _channels(vlfeat, presets.vlfeat(orientations=8)) is None
    assert _channels(vlfeat, replace(vlfeat, bin_offset=0.5)) is None
    opposite_first = replace(vlfeat, bin_offset=9.0)
    assert _channels(vlfeat, opposite_first) == ("undirected", "texture")
    assert _channels(vlfeat, replace(vlfeat, colour="separate")) is None
    reduced = Channels(("undirected",)).reduced(dpm).normalizer
    assert (reduced.parts, reduced.texture) == (("undirected",), "vlfeat")
