"""The UoCTTI normaliser: each cell by the four blocks it lies in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, get_args

from .base import Footprint, Identity, Normalizer, clipped, proportion_errors, root
from .unclip import sum_over_blocks, unclip_exactly

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
UNCLIP_ROUNDS = 60  # after which most cells are exact
UNCLIP_ERROR = 1e-3  # of a sum of squares, which doubles the errors of what was solved for


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

    def texture_sums(self, texture: Tensor) -> Tensor:
        """Σ of the clipped histogram that the texture (B, 4, rows, cols) sums, by blocks up-left … down-right."""
        import torch

        if self.texture == "vlfeat":
            return texture / VLFEAT_TEXTURE
        return torch.stack(in_dpm_order(texture.unbind(1)), dim=1) / DPM_TEXTURE

    def identities(self, channels: Tensor, bins: int, signed: bool, tolerance: float) -> Iterator[Identity]:
        """Entries are at most twice the clip; opposite directions, textures and the squares of blocks add up."""
        parts, most = self.split(channels, bins, signed), 2 * self.clip
        if "zero" in parts:
            yield Identity("the last channel is 0", parts["zero"].abs(), has_scale=False)
        for name in ("directed", "undirected"):
            if name in parts:
                excess = parts[name] - most
                yield Identity(f"no entry but texture exceeds {most:g}", excess.clamp(min=0), is_bound=True)
                highest = excess.flatten(1).amax(dim=1)
                yield Identity(f"the largest entry of all but texture is {most:g}", highest, share=0.0)
        if {"directed", "undirected"} <= {*parts}:
            first, second, both = *parts["directed"].chunk(2, dim=1), parts["undirected"]
            free = (both > 0) & (both < self.clip / 2 - tolerance)  # else it may be clipped in one of the blocks
            errors = (first + second - both)[free]
            yield Identity("opposite directions add up, where they are not clipped", errors, has_scale=False)
        if "blocks" in parts:
            excess = parts["blocks"] - self.clip
            yield Identity(f"no entry exceeds {self.clip:g}", excess.clamp(min=0), is_bound=True)
            yield Identity(f"the largest entry is {self.clip:g}", excess.flatten(1).amax(dim=1), share=0.0)
            yield self._shared_by_blocks(parts["blocks"], tolerance)
        summed = parts.get("undirected" if self.texture == "vlfeat" else "directed")
        if summed is not None and "texture" in parts:
            totals = self.texture_sums(parts["texture"])
            which = "19 … 27" if self.texture == "vlfeat" else "1 … 18"
            if bins != 18:
                which = "of all orientations" if self.texture == "vlfeat" else "of all directions"
            errors = totals.sum(1) - 2 * summed.sum(1)
            yield Identity(f"texture adds up to the sum of channels {which}", errors, has_scale=False)
            yield from self._block_squares(summed, totals, tolerance)
        if self.outside == "missing":
            yield from self._edges(channels)

    def _block_squares(self, summed: Tensor, totals: Tensor, tolerance: float) -> Iterator[Identity]:
        """Σ over the cells of a block of ‖h‖² / N² = 1, where no cell's entry is clipped in all four blocks."""
        import torch

        shares, ratios, known = unclip_exactly(summed, totals, self.clip, UNCLIP_ROUNDS)
        entries = (shares * ratios).clamp(max=self.clip)
        solved = (entries.sum(dim=2) - totals).abs().amax(dim=1) + (entries.sum(dim=1) / 2 - summed).abs().amax(dim=1)
        exact = (solved < tolerance) & (summed < 2 * self.clip - tolerance).all(dim=1) & known.all(dim=1).squeeze(1)
        if self.texture == "dpm":
            shares = shares[:, :, : shares.shape[2] // 2] + shares[:, :, shares.shape[2] // 2 :]
        squares = (shares * ratios).square().sum(dim=2)  # (B, 4, rows, cols)
        ones = torch.ones_like(squares)
        present, full = sum_over_blocks(ones), sum_over_blocks(exact.unsqueeze(1) * ones)
        excess = (sum_over_blocks(squares) * 4 / present - 1) / UNCLIP_ERROR * tolerance
        inner, told = present == 4, present == full
        places = {"the squares of each block": inner}
        if self.outside == "repeat":
            places["the squares of blocks that repeat the border"] = ~inner
        for what, where in places.items():
            errors = excess[where & told]
            yield Identity(f"{what} add up to at most 1", errors.clamp(min=0), share=0.95, is_bound=True)
            yield Identity(f"{what} add up to 1", errors, share=0.0)  # less where the image is as flat as ε

    def _shared_by_blocks(self, blocks: Tensor, tolerance: float) -> Identity:
        """The histogram of a cell in the first of its blocks, and in each of the others, where neither is clipped."""
        batch, _, rows, cols = blocks.shape
        histograms = blocks.reshape(batch, len(BLOCK_NAMES), -1, rows, cols).movedim(2, -1)
        first, second = histograms[:, :1].expand_as(histograms[:, 1:]), histograms[:, 1:]
        errors = proportion_errors(first.flatten(0, 3), second.flatten(0, 3), self.clip, self.clip, tolerance=tolerance)
        return Identity("what four blocks make of a cell is proportional", errors, share=0.99, has_scale=False)

    def _edges(self, channels: Tensor) -> Iterator[Identity]:
        """Cells at the border lie in two blocks, those in corners in one."""
        rows, cols = channels.shape[2:]
        limits = channels.new_full((rows, cols), 2 * self.clip)
        for edge in (limits[0], limits[-1], limits[:, 0], limits[:, -1]):
            edge /= 2
        excess = channels - limits
        yield Identity(f"no entry at the border exceeds {self.clip:g}", excess.clamp(min=0), is_bound=True)
        border = excess[..., limits < 2 * self.clip].flatten(1).amax(dim=1)
        yield Identity(f"the largest entry at the border is {self.clip:g}", border, share=0.0)

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
        return channels[:, :bins]

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """ε, the clip, the texture and its order, where parts begin (-1 if left out), and what changes at the edge."""
        counts = [self.part_channels(part, bins, signed) for part in PARTS]
        begins = [sum(counts[:k]) if count else -1 for k, count in enumerate(counts)]
        dpm = self.texture == "dpm"
        order = [DPM_ORDER.index(block) if dpm else block for block in range(4)]
        numbers = self.epsilon, self.clip, DPM_TEXTURE if dpm else VLFEAT_TEXTURE, *order, *begins
        flags = self.outside == "drop", self.floor, self.outside == "missing", signed, dpm and "texture" in self.parts
        return *numbers, *flags
