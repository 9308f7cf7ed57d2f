"""Each pixel votes into the two nearest cells along either axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

from .base import Pooling

if TYPE_CHECKING:
    from torch import Tensor

Beyond: TypeAlias = Literal["vote", "drop", "repeat"]


@dataclass(frozen=True)
class BilinearCells(Pooling):
    """Each pixel votes into the two nearest cells along either axis, by 1 - distance / cell (Eq. 5-6).

    Attributes:
        beyond: pixels on the far side of the last cell, and those that it lacks if the image ends before it does.
            ``"vote"``: the former vote with the weight that is left, the latter do not exist (VLFeat); ``"drop"``: the
            former do not vote (dlib, Piotr Dollár); ``"repeat"``: nor do they, and for the latter the last pixel that
            votes votes again (DPM).
        edge_gain: what the histograms of the first and the last row and column of cells are multiplied with, which
            miss some votes.
    """

    beyond: Beyond = "vote"
    edge_gain: float = 1.0
    kind: ClassVar[str] = "bilinear"
    interpolates: ClassVar[bool] = True
    """Two neighbouring triangles sum to 1."""

    def weights(self, pixels: int, cells: int, cell: int, axis: int, ring: bool, like: Tensor) -> Tensor:
        """Row k is the bilinear filter of Eq. 5 along one axis, placed at the centre of cell k (Eq. 6).

        Two neighbouring cells share each pixel between their centres.
        """
        # pixels 0 … last - 1 of the cells, or of the image, vote; without the first and the last if there is a ring
        last = {"vote": pixels, "drop": min(cells * cell, pixels), "repeat": cells * cell}[self.beyond]
        matrix = triangles(max(last, pixels), cell, cells, like)
        matrix[:, last:] = 0
        if ring:
            matrix[:, [0, last - 1]] = 0
        if last > pixels:  # DPM: what the image lacks is its last pixel that votes, again
            of_last = max(pixels - 1 - ring, 0)
            matrix[:, of_last] += matrix[:, of_last + 1 :].sum(dim=1)
            matrix = matrix[:, :pixels].contiguous()
            matrix[:, of_last + 1 :] = 0
        for outermost in {0, cells - 1}:
            matrix[outermost] *= self.edge_gain
        return matrix

    def reach(self, cell: int, axis: int) -> tuple[int, int]:
        """A cell more at either side, for weights and for the pixels that vote again."""
        return cell, 2 * cell


def triangles(pixels: int, cell: int, cells: int, like: Tensor) -> Tensor:
    """f^s of Eq. 5 along one axis, (cells, pixels): 1 - distance to each cell's centre in cells, at least 0.

    Distances are whole numbers of half pixels: a weight is rounded once, and alike wherever the cell is.
    """
    import torch

    ahead = 2 * torch.arange(pixels, device=like.device) + 1 - cell  # of the centre of cell 0
    before = torch.div(ahead, 2 * cell, rounding_mode="floor")  # the cell whose centre is at the pixel's or before it
    of_next = (ahead - 2 * cell * before).to(like.dtype) / (2 * cell)
    of_this = (2 * cell * (before + 1) - ahead).to(like.dtype) / (2 * cell)
    # a row before the first cell and one after the last for the votes that leave the image
    matrix = torch.zeros(cells + 2, pixels, dtype=like.dtype, device=like.device)
    matrix.scatter_(0, (before + 1).clamp(max=cells + 1).unsqueeze(0), of_this.unsqueeze(0))
    matrix.scatter_(0, (before + 2).clamp(max=cells + 1).unsqueeze(0), of_next.unsqueeze(0))
    return matrix[1:-1]
