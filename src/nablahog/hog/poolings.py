"""The ways in which pixels vote into cells, each with its constants: Eq. 5-6 and what libraries do instead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from .checks import check_choice, check_pair, check_positive

Beyond: TypeAlias = Literal["vote", "drop", "repeat"]


@dataclass(frozen=True)
class BilinearCells:
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

    def __post_init__(self) -> None:
        check_choice("beyond", self.beyond, Beyond)
        check_positive("edge_gain", self.edge_gain)


@dataclass(frozen=True)
class BoxCells:
    """Each pixel votes into its own cell.

    Attributes:
        mean: whether a histogram is the mean over its pixels, not their sum.
        window: pixels of the side of a Gaussian window, of sum 1, that is tiled over the image and weighs its votes;
            its standard deviation is half of that.  0 for none.
    """

    mean: bool = False
    window: int = 0
    kind: ClassVar[str] = "box"

    def __post_init__(self) -> None:
        if not isinstance(self.mean, bool):
            raise ValueError(f"mean must be True or False, got {self.mean!r}")
        if type(self.window) is not int or self.window < 0 or self.window == 1:
            raise ValueError(f"window must be 0 or a number of pixels of at least 2, got {self.window!r}")


@dataclass(frozen=True)
class BlockCells:
    """Blocks of cells at a step in pixels, each with histograms of its own: votes do not leave their block (OpenCV).

    Attributes:
        block: (height, width) of a block in pixels, whole cells.
        step: (height, width) in pixels from one block to the next.
        sigma: standard deviation in pixels of the Gaussian that weighs a block's votes; its middle is the pixel
            of index side / 2.
    """

    block: tuple[int, int]
    step: tuple[int, int]
    sigma: float
    kind: ClassVar[str] = "block"

    def __post_init__(self) -> None:
        check_pair("block", self.block)
        check_pair("step", self.step)
        check_positive("sigma", self.sigma)


Pooling: TypeAlias = BilinearCells | BoxCells | BlockCells
POOLINGS: dict[str, type[Pooling]] = {p.kind: p for p in (BilinearCells, BoxCells, BlockCells)}
