"""A normaliser and a pooling that are known only to their own classes work everywhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import hog, reconstruct, stream
from nablahog.hog import BilinearCells, GlobalNorm, HOGSpec
from nablahog.hog.descriptor import Backend, histograms
from nablahog.hog.kernels.loops import supports
from nablahog.hog.normalizers import Footprint, Normalizer, PerCell
from nablahog.hog.poolings import Pooling, Taps
from nablahog.invert import Search

from .differences import assert_jacobian_equals_central_differences
from .zoo import noise, spec


@dataclass(frozen=True)
class Pairs(Normalizer):
    """Each cell but the last of a row, and its right neighbour, by the sum over both and over the cell above them."""

    epsilon: float = 0.5
    kind: ClassVar[str] = "pairs"

    def channels(self, bins: int, signed: bool) -> int:
        return 2 * bins

    def footprint(self, axis: int) -> Footprint:
        return Footprint(extent=1 + axis)

    def reach(self) -> int | None:
        return 1

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        votes = (histograms.movedim(1, -1) @ histograms.new_ones(histograms.shape[1], 1)).movedim(-1, 1)
        around = votes + torch.cat([votes[..., :1, :], votes[..., :-1, :]], dim=-2)
        pairs = torch.cat([histograms[..., :-1], histograms[..., 1:]], dim=1)
        return pairs / (around[..., :-1] + around[..., 1:] + self.epsilon)

    def channel_names(self, bins: list[str], axes: list[str]) -> list[str]:
        return [f"{side}: {each}" for side in ("left", "right") for each in bins]

    def cell_entries(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        left, right = channels[:, :bins], channels[:, bins:]
        inner = (left[..., 1:] + right[..., :-1]) / 2
        return torch.cat([left[..., :1], inner, right[..., -1:]], dim=-1)

    @property
    def fixes_contrast(self) -> bool:
        return False


@dataclass(frozen=True)
class WideCells(Pooling):
    """Each pixel votes into the cell on either side of its own, too, by a half."""

    kind: ClassVar[str] = "wide"

    def taps(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Taps:
        weights = like.new_full((pixels, 3), 0.5)
        weights[:, 1] = 1
        if ring:
            weights[[0, -1]] = 0
        return Taps(torch.arange(pixels, device=like.device) // cell - 1, weights)

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        return cell, 2 * cell


@pytest.fixture(params=["normalizer", "pooling", "both"])
def new(request: pytest.FixtureRequest) -> HOGSpec:
    normalizer = GlobalNorm(0.1) if request.param == "pooling" else Pairs()
    pooling = BilinearCells() if request.param == "normalizer" else WideCells()
    return spec(normalizer=normalizer, pooling=pooling)


def test_descriptor(new: HOGSpec) -> None:
    """On a CPU the compiled cells are followed by what the normaliser says, which is all of it elsewhere."""
    assert supports(new)
    images = noise(2, 3, 18, 25)
    expected = hog(images, new, backend="torch")
    assert expected.shape == (2, *new.grid(18, 25), new.channels)
    assert_close(hog(images, new), expected, rtol=0, atol=1e-12)
    assert_close(histograms(images, new), histograms(images, new, backend="torch"), rtol=0, atol=1e-12)
    assert HOGSpec.from_json(new.to_json()) == new
    assert new.image_size(*new.grid(16, 24)) == (16, 24)


@pytest.mark.parametrize("backend", ["auto", "torch"])
def test_autocast_leaves_its_precision(backend: Backend) -> None:
    """Of all that PyTorch computes: products of float32 matrices would be of bfloat16."""
    images, new = noise(1, 3, 18, 25), spec(normalizer=Pairs(), pooling=WideCells())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        under_autocast = hog(images.float(), new, backend=backend)
    assert_close(under_autocast.double(), hog(images, new, backend=backend), rtol=0, atol=1e-6)


@pytest.mark.slow
def test_derivatives(new: HOGSpec) -> None:
    assert_jacobian_equals_central_differences(noise(1, 1, 8, 9), new)
    images = noise(1, 1, 8, 12).requires_grad_()
    assert torch.autograd.gradgradcheck(lambda x: hog(x, new), images)
    compiled = torch.compile(lambda x: hog(x, new), backend="aot_eager", fullgraph=True)
    assert_close(compiled(images), hog(images, new), rtol=0, atol=1e-12)
    many = noise(3, 2, 1, 8, 12)
    assert_close(torch.func.vmap(lambda x: hog(x, new))(many), torch.stack([hog(x, new) for x in many]))


def test_streamed(new: HOGSpec) -> None:
    image = noise(70, 21, 1, dtype=torch.float32).numpy()
    strips = list(stream(image, new, memory=1))
    assert len(strips) > 5
    expected = hog(torch.from_numpy(image).permute(2, 0, 1)[None], new)[0]
    got = torch.from_numpy(np.concatenate([strip.descriptor for strip in strips]))
    assert_close(got, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_reconstructed(new: HOGSpec) -> None:
    y, x = torch.meshgrid(torch.linspace(-1, 1, 40), torch.linspace(-1, 1, 32), indexing="ij")
    image = torch.sigmoid(15 * (0.6 - torch.hypot(x, y)))[None, None]
    result = reconstruct(hog(image, new), new, (40, 32), search=Search(max_evaluations=150), prior=None)
    assert result.distance.item() < 0.2
    alike = np.corrcoef(result.image.flatten().numpy(), image.flatten().numpy())[0, 1]
    assert abs(alike) > 0.6  # or its negative: bins are not signed


def test_nothing_exact_is_known_of_it() -> None:
    channels = noise(1, 8, 3, 4)
    assert list(Pairs().identities(channels, 4, False, 1e-6)) == []
    assert Pairs().needs_directed


# --- what is left out ------------------------------------------------------------------------------------------------


def test_a_kind_is_of_one_class() -> None:
    """Which may come again, as one of a module that is reloaded does."""
    for _ in range(2):

        class Again(PerCell):
            kind = "again"

    assert Normalizer.kinds["again"] is Again
    with pytest.raises(TypeError, match=r"the kind 'again' of Other is that of .*Again: choose another"):
        type("Other", (PerCell,), {"kind": "again"})
    assert Normalizer.kinds["again"] is Again


def test_cells_must_be_at_regular_places_to_be_streamed() -> None:
    @dataclass(frozen=True)
    class Growing(WideCells):
        kind: ClassVar[str] = "growing"

        def taps(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Taps:
            taps = super().taps(pixels, cells, cell, axis, ring, like)
            return Taps(torch.arange(pixels).sqrt().long(), taps.weights)

    with pytest.raises(AssertionError, match="do not repeat"):
        stream(np.zeros((90, 9), np.float32), spec(pooling=Growing()))


def test_one_factor_for_an_image_must_be_said() -> None:
    """Whoever needs the whole image, and does not say by what a histogram is multiplied, is not streamed."""

    @dataclass(frozen=True)
    class Largest(PerCell):
        kind: ClassVar[str] = "largest"
        fixes_contrast = False

        def reach(self) -> int | None:
            return None

        def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
            return histograms / histograms.amax(dim=(1, 2, 3), keepdim=True).clamp(min=0.1)

    s = spec(normalizer=Largest())
    assert_close(hog(noise(1, 1, 9, 9), s), hog(noise(1, 1, 9, 9), s, backend="torch"))
    with pytest.raises(NotImplementedError, match=r"^the largest normaliser .* Largest\.image_factor"):
        list(stream(np.zeros((9, 9), np.float32), s))
