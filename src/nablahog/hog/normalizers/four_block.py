"""The UoCTTI normaliser: each cell by the four blocks it lies in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, get_args

from .base import Footprint, Normalizer, clipped, root

if TYPE_CHECKING:
    from torch import Tensor

Part: TypeAlias = Literal["directed", "undirected", "texture", "blocks", "zero"]
Texture: TypeAlias = Literal["vlfeat", "dpm"]
Outside: TypeAlias = Literal["repeat", "drop", "missing"]
PARTS: tuple[Part, ...] = get_args(Part)
HISTOGRAMS: tuple[Part, ...] = ("directed", "undirected", "blocks")
VLFEAT_TEXTURE = 1 / math.sqrt(18)  # made for 18 directions; VLFeat keeps it for any number
DPM_TEXTURE = 0.2357  # the same, to four decimals
BLOCK_NAMES = ("up-left", "up-right", "down-left", "down-right")
DPM_ORDER = [3, 1, 2, 0]  # of the blocks
in_dpm_order = itemgetter(*DPM_ORDER)


@dataclass(frozen=True)
class FourBlockNorm(Normalizer):
    """The UoCTTI normaliser: each cell by the four 2x2-cell blocks it lies in (VLFeat ``vl/hog.c``).

    The energy of a block is the sum of squares of its cells' contrast-insensitive histograms.  A spec whose bins are
    not signed has no other; its parts are made of these.  The channels are the ½-weighted sums over the four blocks of
    the clipped directed (2n) and undirected (n) histograms, and four texture channels.

    Attributes:
        epsilon: see ``floor``; absolute, in squared votes at the spec's ``value_range``, or in votes if it is a floor.
        clip: upper bound of a normalised entry.
        parts: which of these channels the descriptor has, in this order, not texture or zero alone: ``"directed"``,
            ``"undirected"``, ``"texture"``, ``"blocks"`` (4n: the clipped undirected histogram for each block, not
            summed) and ``"zero"`` (one that is 0 in cells of an image; DPM's truncation).
        texture: ``"vlfeat"``: Σ of the clipped undirected histogram / √18 for the blocks up-left, up-right, down-left,
            down-right; ``"dpm"``: 0.2357 · Σ of the clipped directed one, in the order down-right, up-right, down-left,
            up-left.
        outside: blocks that reach beyond the grid.  ``"repeat"``: cells there repeat the edge; ``"drop"``: the
            outermost cells, which lie in them, are not part of the descriptor; ``"missing"``: they add nothing.
        floor: a block divides by √(energy + ε); if true, by √energy, but at least by ε.

    >>> from dataclasses import replace
    >>> from nablahog.hog import FourBlockNorm
    >>> spec = replace(nablahog.presets.uoctti(), normalizer=FourBlockNorm(parts=("directed",)))
    >>> nablahog.hog(torch.rand(1, 1, 32, 32), spec).shape
    torch.Size([1, 4, 4, 18])
    """

    epsilon: float = 1e-4
    clip: float = 0.2
    parts: tuple[Part, ...] = ("directed", "undirected", "texture")
    texture: Texture = "vlfeat"
    outside: Outside = "repeat"
    floor: bool = False
    kind: ClassVar[str] = "four-block"
    fixes_contrast = False
    """Blocks whose energy is well above ε have one length."""

    def __post_init__(self) -> None:
        super().__post_init__()
        ordered = (some for n in range(1, 1 + len(PARTS)) for some in itertools.combinations(PARTS, n))
        allowed = [parts for parts in ordered if {*parts} & {*HISTOGRAMS}]
        if self.parts not in allowed:
            raise ValueError(
                f"parts must be a tuple of {', '.join(map(repr, PARTS))}, in this order, not of texture or zero alone, "
                f"got {self.parts!r}"
            )

    def check(self, bins: int, signed: bool) -> None:
        """Bins must be signed for channels of directed histograms, and signed ones have opposites."""
        if self.needs_directed and not signed:
            raise ValueError(
                f"a four-block normaliser with the parts {', '.join(map(repr, self.parts))} sums directed "
                f"histograms: signed must be True, got {signed}"
            )
        if signed and bins % 2:
            raise ValueError(f"four-block normalisers pair each bin with its opposite: bins must be even, got {bins}")

    @property
    def needs_directed(self) -> bool:
        """Whether some channel is made from directed histograms."""
        return "directed" in self.parts or (self.texture == "dpm" and "texture" in self.parts)

    def part_channels(self, part: Part, bins: int, signed: bool) -> int:
        """Channels of one part, 0 if it is left out: of n orientations over 180° these are 2n, n, 4, 4n and 1."""
        if part not in self.parts:
            return 0
        n = bins // 2 if signed else bins
        return {"directed": 2 * n, "undirected": n, "texture": 4, "blocks": 4 * n, "zero": 1}[part]

    def channels(self, bins: int, signed: bool) -> int:
        return sum(self.part_channels(part, bins, signed) for part in PARTS)

    def footprint(self, axis: int) -> Footprint:
        return Footprint(margin=1 if self.outside == "drop" else 0)

    def reach(self) -> int | None:
        return 1

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """Histograms (B, bins, rows, cols) to (B, channels, rows, cols), as in VLFeat ``vl/hog.c``."""
        import torch

        n = histograms.shape[1] // 2
        undirected = histograms[:, :n] + histograms[:, n:] if signed else histograms
        factors = self._block_factors(undirected)
        if self.outside == "drop":
            histograms, undirected, factors = (x[..., 1:-1, 1:-1] for x in (histograms, undirected, factors))

        def blocks(cells: Tensor) -> Tensor:
            return clipped(cells.unsqueeze(1) * factors, self.clip)  # (B, 4, bins, rows, cols)

        makers: dict[Part, Callable[[], Tensor]] = {
            "directed": lambda: blocks(histograms).sum(dim=1) / 2,
            "undirected": lambda: blocks(undirected).sum(dim=1) / 2,
            "texture": lambda: (
                blocks(undirected).sum(dim=2) * VLFEAT_TEXTURE
                if self.texture == "vlfeat"
                else torch.stack(in_dpm_order(blocks(histograms).sum(dim=2).unbind(1)), dim=1) * DPM_TEXTURE
            ),
            "blocks": lambda: blocks(undirected).flatten(1, 2),
            "zero": lambda: torch.zeros_like(histograms[:, :1]),
        }
        return torch.cat([makers[part]() for part in self.parts], dim=1)

    def _block_factors(self, undirected: Tensor) -> Tensor:
        """Factors of each cell from its blocks up-left, up-right, down-left, down-right: (B, 4, 1, r, c)."""
        import torch

        def repeat_edge(x: Tensor, dim: int) -> Tensor:
            return torch.cat([x.narrow(dim, 0, 1), x, x.narrow(dim, -1, 1)], dim)

        energy = repeat_edge(repeat_edge(undirected.square().sum(dim=1, keepdim=True), -2), -1)
        energy = energy[..., :-1] + energy[..., 1:]
        energy = energy[..., :-1, :] + energy[..., 1:, :]  # of blocks around cell corners: (B, 1, rows+1, cols+1)
        if self.floor:
            factor = 1 / torch.maximum(root(energy), energy.new_full((), self.epsilon))
        else:
            factor = torch.rsqrt(energy + self.epsilon)
        if self.outside == "missing":
            inner = torch.zeros_like(factor)
            inner[..., 1:-1, 1:-1] = 1
            factor = factor * inner
        top, bottom = factor[..., :-1, :], factor[..., 1:, :]
        return torch.stack([top[..., :-1], top[..., 1:], bottom[..., :-1], bottom[..., 1:]], dim=1)

    def channel_names(self, bins: list[str], axes: list[str]) -> list[str]:
        names: dict[Part, list[str]] = {
            "directed": [f"directed: {orientation}" for orientation in bins],
            "undirected": [f"undirected: {orientation}" for orientation in axes],
            "texture": [
                f"texture: block {BLOCK_NAMES[k]}" for k in (range(4) if self.texture == "vlfeat" else DPM_ORDER)
            ],
            "blocks": [f"block {block}: {orientation}" for block in BLOCK_NAMES for orientation in axes],
            "zero": ["always 0"],
        }
        return [name for part in self.parts for name in names[part]]

    def split(self, channels: Tensor, bins: int, signed: bool) -> dict[Part, Tensor]:
        """Channels (B, channels, rows, cols) by their parts."""
        lengths = [self.part_channels(part, bins, signed) for part in self.parts]
        return dict(zip(self.parts, channels.split_with_sizes(lengths, dim=1), strict=True))

    def cell_entries(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """The directed entries, or for want of them each undirected one twice."""
        import torch

        if "directed" in self.parts:
            return channels[:, :bins]
        undirected = self._undirected(channels, bins, signed)
        return torch.cat([undirected, undirected], dim=1) if signed else undirected

    def _undirected(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """The undirected entries (B, n, rows, cols), or for want of them the mean over the blocks."""
        parts = self.split(channels, bins, signed)
        if "undirected" in parts:
            return parts["undirected"]
        batch, _, rows, cols = channels.shape
        return parts["blocks"].reshape(batch, 4, -1, rows, cols).mean(dim=1)

    @property
    def keeps_directions(self) -> bool:
        return "directed" in self.parts

    def bin_weights(self, weights: Tensor, bins: int, signed: bool) -> Tensor:
        """Weights of directed and undirected channels together."""
        import torch

        directed = self.cell_entries(weights, bins, signed)
        if not signed or not {"directed", "undirected"} <= {*self.parts}:
            return directed
        undirected = self.split(weights, bins, signed)["undirected"]
        return (directed + torch.cat([undirected, undirected], dim=1) / 2) / 2

    def edge_strengths(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """The undirected entries, or for want of them the directed ones, or the mean over the blocks."""
        if "undirected" in self.parts or "directed" not in self.parts:
            return self._undirected(channels, bins, signed)
        return channels[:, : bins if signed else 2 * bins]

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """ε, the clip, the texture and its order, where parts begin (-1 if left out), and what changes at the edge."""
        counts = [self.part_channels(part, bins, signed) for part in PARTS]
        begins = [sum(counts[:k]) if count else -1 for k, count in enumerate(counts)]
        dpm = self.texture == "dpm"
        order = [DPM_ORDER.index(block) if dpm else block for block in range(4)]
        numbers = self.epsilon, self.clip, DPM_TEXTURE if dpm else VLFEAT_TEXTURE, *order, *begins
        flags = self.outside == "drop", self.floor, self.outside == "missing", signed, dpm and "texture" in self.parts
        return *numbers, *flags
