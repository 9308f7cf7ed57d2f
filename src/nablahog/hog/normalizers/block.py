"""Rectangular blocks of cells, each normalised for itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, get_args

from .base import Footprint, Identity, Normalizer, clipped, proportion_errors, root

if TYPE_CHECKING:
    from torch import Tensor

LEAST_VOTES = 2.0  # times ε: the length of a block that is not flat
CLIPPED_SHARE = 0.1  # of blocks, from which on clipped entries say something: a few look clipped by chance
SHORTFALL = 0.2  # relative error, by rounding to float32, of how much shorter than 1 blocks are

BlockForm: TypeAlias = Literal["L1", "L1-sqrt", "L2", "L2-Hys"]


@dataclass(frozen=True)
class BlockNorm(Normalizer):
    """Rectangular blocks of cells, each normalised for itself (scikit-image ``feature/_hog.py``, OpenCV ``hog.cpp``).

    A block's channels are those of its cells, row by row of cells.

    Attributes:
        block: (rows, cols) of cells in a block.
        step: (rows, cols) of cells from one block to the next.
        form: of a block's vector v.  ``"L1"``: v / (Σ|v| + ε); ``"L1-sqrt"``: the root of that, whose derivative at an
            empty entry counts as 0; ``"L2"``: v / √(Σv² + ε²); ``"L2-Hys"``: L2, clipped, and L2 with ε₂ again.
        epsilon: ε, in votes at the spec's ``value_range``.
        epsilon_again: ε₂ of L2-Hys, without unit.
        epsilon_outside_root: whether ε and ε₂ are added to the root of L2 and L2-Hys, √Σv² + ε, as in OpenCV.
        clip: of L2-Hys.

    >>> from dataclasses import replace
    >>> from nablahog.hog import BlockNorm
    >>> spec = replace(nablahog.presets.paper(), normalizer=BlockNorm(block=(2, 2)))
    >>> nablahog.hog(torch.rand(1, 1, 32, 32), spec).shape  # 3x3 blocks of 2x2 cells of 9 bins
    torch.Size([1, 3, 3, 36])
    """

    block: tuple[int, int]
    step: tuple[int, int] = (1, 1)
    form: BlockForm = "L2-Hys"
    epsilon: float = 1e-5
    epsilon_again: float = 1e-5
    epsilon_outside_root: bool = False
    clip: float = 0.2
    kind: ClassVar[str] = "block"
    fixes_contrast = False
    """Blocks have one length."""

    def channels(self, bins: int, signed: bool) -> int:
        return self.block[0] * self.block[1] * bins

    def footprint(self, axis: int) -> Footprint:
        return Footprint(self.step[axis], self.block[axis])

    def reach(self) -> int | None:
        return 0

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """Histograms (B, bins, rows, cols) to (B, channels, rows of blocks, columns of blocks)."""
        import torch

        (high, wide), (down, across) = self.block, self.step
        counts = (self.footprint(axis).count(histograms.shape[2 + axis]) for axis in (0, 1))
        rows, cols = ((count - 1) * step + 1 for count, step in zip(counts, self.step, strict=True))
        # not by unfold, whose derivative torch.func.vmap does image by image
        cells_of_blocks = [
            histograms[:, :, row : row + rows : down, col : col + cols : across]
            for row in range(high)
            for col in range(wide)
        ]
        blocks = torch.stack(cells_of_blocks, dim=1).flatten(1, 2)
        if self.form.startswith("L1"):  # histograms are not negative
            blocks = blocks / (blocks.sum(dim=1, keepdim=True) + self.epsilon)
            return blocks if self.form == "L1" else root(blocks)
        blocks = self._unit(blocks, self.epsilon)
        if self.form == "L2":
            return blocks
        return self._unit(clipped(blocks, self.clip), self.epsilon_again)

    def _unit(self, blocks: Tensor, epsilon: float) -> Tensor:
        energy = blocks.square().sum(dim=1, keepdim=True)
        if self.epsilon_outside_root:
            return blocks / (root(energy) + epsilon)
        return blocks * (energy + epsilon**2).rsqrt()

    def channel_names(self, bins: list[str], axes: list[str]) -> list[str]:
        cells = [(row, col) for row in range(self.block[0]) for col in range(self.block[1])]
        return [f"cell {row}, {col} of the block: {orientation}" for row, col in cells for orientation in bins]

    def cell_entries(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """The mean over all blocks that a cell is in, of squares for L1-sqrt; of cells between blocks 0."""
        return self._block_means(channels * channels.abs() if self.form == "L1-sqrt" else channels, bins)

    def bin_weights(self, weights: Tensor, bins: int, signed: bool) -> Tensor:
        """The mean over all blocks that a cell is in; of cells between blocks 0."""
        return self._block_means(weights, bins)

    def _block_means(self, channels: Tensor, bins: int) -> Tensor:
        import torch
        from torch.nn.functional import fold

        batch, _, rows, cols = channels.shape
        size = self.footprint(0).cells(rows), self.footprint(1).cells(cols)
        block_cells = self.block[0] * self.block[1]
        blocks = channels.reshape(batch, block_cells, bins, rows * cols).transpose(1, 2).flatten(1, 2)
        counts = fold(torch.ones_like(blocks[:1, :block_cells]), size, self.block, stride=self.step).clamp(min=1)
        return fold(blocks, size, self.block, stride=self.step) / counts

    def identities(self, channels: Tensor, bins: int, signed: bool, tolerance: float) -> Iterator[Identity]:
        """Blocks have a length, entries the clip in common; cells in several blocks differ by one factor."""
        count, numbers = channels.shape[1], channels.movedim(1, -1)
        sizes = numbers.sum(dim=-1) if self.form == "L1" else numbers.norm(dim=-1)
        used = sizes > 0
        sizes, largest = sizes[used], numbers[used].topk(2, dim=-1).values
        low, high = self._sizes()
        what = "add up to" if self.form == "L1" else "have length"
        is_range = high - low > tolerance
        between = f"{low:.6g} to {high:.6g}" if is_range else "1"
        yield Identity(f"no {count} numbers exceed length {high:.6g}", (sizes - high).clamp(min=0), is_bound=True)
        sentence = f"every {count} numbers {what} {between}"
        yield Identity(sentence, (low - sizes).clamp(min=0), share=0.5, is_bound=is_range)
        if self.form == "L2-Hys":
            yield from self._clips(sizes, largest, tolerance)
        if self.step == (1, 1) != self.block:
            yield from self._shared_cells(channels, bins, tolerance)

    def _clips(self, sizes: Tensor, largest: Tensor, tolerance: float) -> Iterator[Identity]:
        """What holds of the lengths of blocks, and their largest two entries, if these are clipped."""
        # d = c / (‖c‖ + ε₂) of clipped entries c, so that c = d · ε₂ / (1 - ‖d‖)
        clips = largest[:, 0] * self.epsilon_again - self.clip * (1 - sizes)
        ties, tied = (largest[:, 0] - largest[:, 1]) / largest[:, 0], 0.1
        if self.epsilon_outside_root:
            # blocks of other dialects have lengths that would make c longer than this
            yield Identity(f"no entry exceeds the clip {self.clip:g}", clips.clamp(min=0), has_scale=False)
            if float((clips.abs() <= tolerance).double().mean()) >= CLIPPED_SHARE:
                yield Identity(f"the largest entries were clipped at {self.clip:g}", clips, share=CLIPPED_SHARE)
            tied = 0.0  # ε makes faint blocks so short that nothing is clipped
        sentence = "the largest entries of blocks are equal, as clipped ones"
        yield Identity(sentence, ties, share=tied, is_bound=True, has_scale=False)
        if not self.epsilon_outside_root:
            # d = c / √(‖c‖² + ε₂²), so that 1 - ‖d‖² = (d · ε₂ / c)²: so little that only the sum over all blocks tells
            are_clipped = ties <= tolerance
            expected = (largest[are_clipped, 0] * self.epsilon_again / self.clip).square().sum()
            if expected > tolerance * are_clipped.sum().sqrt():
                ratio = (1 - sizes[are_clipped].square()).sum() / expected
                sentence = f"blocks are shorter than 1 by what ε₂ = {self.epsilon_again:g} takes"
                yield Identity(sentence, (ratio - 1)[None] * (tolerance / SHORTFALL))

    def scale(self, channels: Tensor) -> float:
        """From the longest block, or the largest sum; of clipped ones of OpenCV, from the clip they have in common."""
        numbers = channels.movedim(1, -1)
        sizes = numbers.sum(dim=-1) if self.form == "L1" else numbers.norm(dim=-1)
        if self.form == "L2-Hys" and self.epsilon_outside_root:  # see identities
            return float((sizes + numbers.amax(dim=-1) * self.epsilon_again / self.clip).max())
        return float(sizes.max()) / self._sizes()[1]

    def _sizes(self) -> tuple[float, float]:
        """The least and the largest length, or sum, of a block that is not flat."""
        if self.form != "L2-Hys":
            return (1 + LEAST_VOTES**-2) ** -0.5, 1.0
        least, most = (
            1 / (1 + self.epsilon_again / length)
            if self.epsilon_outside_root
            else (1 + (self.epsilon_again / length) ** 2) ** -0.5
            for length in (self.clip, 1.0)
        )
        return least, most

    def _shared_cells(self, channels: Tensor, bins: int, tolerance: float) -> Iterator[Identity]:
        """Along both axes, the histograms that neighbouring blocks share, where neither is clipped."""
        batch, _, rows, cols = channels.shape
        blocks = channels.reshape(batch, *self.block, bins, rows, cols)
        clips = blocks.amax(dim=(1, 2, 3), keepdim=True).expand_as(blocks)
        for axis in (0, 1):
            inner, places = self.block[axis] - 1, blocks.shape[4 + axis] - 1
            if inner < 1 or places < 1:
                continue
            rows_of_cells = [
                x.narrow(1 + axis, 1 - start, inner).narrow(4 + axis, start, places).movedim((4, 5), (1, 2)).flatten(3)
                for x in (blocks, clips)
                for start in (0, 1)
            ]
            errors = proportion_errors(*rows_of_cells, tolerance=tolerance)
            sentence = "cells that neighbouring blocks share are proportional"
            yield Identity(sentence, errors.flatten(), share=0.99, has_scale=False)

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """All fields; the form by its number."""
        form = get_args(BlockForm).index(self.form)
        numbers = self.epsilon, self.epsilon_again, self.clip, form, self.epsilon_outside_root
        return *self.block, *self.step, *numbers

    @property
    def layout_block(self) -> tuple[int, int] | None:
        return self.block
