"""The dialects by name: each is one HOGSpec with its source."""

from __future__ import annotations

from .spec import Border, Colour, FourBlockNorm, GlobalForm, GlobalNorm, HOGSpec, PartialCells, Vote


def _pair(cell_size: int | tuple[int, int]) -> tuple[int, int]:
    return (cell_size, cell_size) if isinstance(cell_size, int) else cell_size


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
        cell_size=_pair(cell_size),
        partial_cells=partial_cells,
        normalizer=GlobalNorm(epsilon=epsilon, form=global_form),
    )


def uoctti(
    cell_size: int | tuple[int, int] = 8,
    *,
    vote: Vote = "linear",
    orientations: int = 9,
    colour: Colour = "largest",
) -> HOGSpec:
    """The UoCTTI HOG of Felzenszwalb et al. as VLFeat computes it (``vl/hog.c``): 18 + 9 + 4 channels.

    Args:
        cell_size: pixels of a cell, one number or (height, width).
        vote: ``"linear"`` (VLFeat's ``bilinearOrientations``), differentiable in the orientation too, or ``"hard"``
            (VLFeat's default).
        orientations: undirected orientations n over 180°; 3n + 4 channels.
        colour: ``"largest"``, as in VLFeat and DPM; ``"gray"`` converts first, as Eq. 1 of the paper.
    """
    return HOGSpec(
        name="uoctti",
        value_range=255.0,
        colour=colour,
        border="ignore",
        bins=2 * orientations,
        signed=True,
        bin_offset=0.0,
        vote=vote,
        cell_size=_pair(cell_size),
        partial_cells="round",
        normalizer=FourBlockNorm(),
    )


def aubry(
    cell_size: int | tuple[int, int] = 5,
    *,
    vote: Vote = "linear",
    orientations: int = 9,
    colour: Colour = "largest",
) -> HOGSpec:
    """The contrast-insensitive channels with which Aubry et al. ("Seeing 3D chairs") find renderings in photographs.

    As their ``features.cc``: cells of 5, ε = 0.1 for images in 0…1 (they describe their renderings in 0…255, where ε
    does nothing, but photographs in 0…1), clip 0.2, no directed and no texture channels.  With hard votes and sides
    that are multiples of the cell, all but the outermost ring of cells is exactly theirs, up to their rounding of
    directions to four decimals.  That ring they leave out and put zeros in its place, while here, as in VLFeat, blocks
    beyond the edge repeat it; and where a cell is cut by the border they count its last gradient again for each pixel
    that is missing.  Linear votes, the default, are not theirs: they make the descriptor continuous, so that its
    derivative says how it changes with orientation.

    Args:
        cell_size: pixels of a cell, one number or (height, width).
        vote: ``"linear"``, differentiable in the orientation too, or ``"hard"``, theirs.
        orientations: undirected orientations n over 180°, one channel each.
        colour: ``"largest"``, theirs; ``"gray"`` converts first, as Eq. 1 of the paper.
    """
    return HOGSpec(
        name="aubry",
        value_range=1.0,
        colour=colour,
        border="ignore",
        bins=2 * orientations,
        signed=True,
        bin_offset=0.0,
        vote=vote,
        cell_size=_pair(cell_size),
        partial_cells="round",
        normalizer=FourBlockNorm(epsilon=0.1, parts=("undirected",)),
    )
