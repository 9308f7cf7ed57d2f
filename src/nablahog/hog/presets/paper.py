"""The HOG of the paper."""

from __future__ import annotations

from ..checks import pair
from ..normalizers import GlobalForm, GlobalNorm
from ..poolings import PartialCells
from ..spec import Border, HOGSpec


def paper(
    cell_size: int | tuple[int, int] = 8,
    *,
    bins: int = 9,
    bin_offset: float = 0.5,
    epsilon: float = 1e-5,
    global_form: GlobalForm = "printed",
    border: Border = "reflect",
    partial_cells: PartialCells = "floor",
) -> HOGSpec:
    """The Dalal-type HOG of the paper, Eq. 1-7: gray, [-1, 0, 1], 9 unsigned bins, linear votes, one global normaliser.

    The paper leaves the following open.

    Args:
        cell_size: pixels of a cell, one number or (height, width).  Default 8: the paper's multi-scale variant divides
            it by √64, so 8 is the smallest cell size for which all its scales exist.
        bins: orientation bins over 180°; the paper and Dalal use 9.
        bin_offset: 0.5, bin k is centred at (k + ½)·20°.  Eq. 3 calls μ_b the "central value" of a bin, and 9 bins
            "spaced over 0°-180°" have their centres at half a bin; 0 centres the first bin on 0° as VLFeat does.
        epsilon: ε of Eq. 7, "a small positive constant".  1e-5 is scikit-image's; it acts only where the whole image
            is flat.
        global_form: ``"printed"`` divides by √(‖v‖ + ε), letter by letter Eq. 7; ``"robust"`` divides by √(‖v‖² + ε²),
            which the prose ("robust L2-norm") means in Dalal and Triggs.  As printed, the descriptor still scales with
            the square root of the image's contrast.
        border: ``"reflect"``: no derivative across the image border, the rule that scikit-image and OpenCV share;
            zero padding would draw a false frame around the image.
        partial_cells: ``"floor"``: only whole cells count, as in Dalal's; the paper's images hold whole cells only.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.paper()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (16, 8), 9)
    """
    return HOGSpec(
        name="paper",
        value_range=1.0,
        colour="gray",
        border=border,
        bins=bins,
        signed=False,
        bin_offset=bin_offset,
        vote="linear",
        cell_size=pair(cell_size),
        partial_cells=partial_cells,
        normalizer=GlobalNorm(epsilon=epsilon, form=global_form),
    )
