"""The HOG of Felzenszwalb et al. (UoCTTI), as their code and six others compute it."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias

from ...inputs.numbers import LONGEST_SIDE, as_integer, as_square_or_size, as_truth, check_choice
from ..normalizers import FourBlockNorm
from ..normalizers.four_block import Part
from ..poolings import BilinearCells
from ..spec import Colour, HOGSpec, Vote

Variant: TypeAlias = Literal["uoctti", "dalaltriggs"]

_UOCTTI = HOGSpec(
    name="uoctti",
    value_range=255.0,
    colour="largest",
    border="ignore",
    bins=18,
    signed=True,
    bin_offset=0.0,
    vote="hard",
    cell_size=(8, 8),
    partial_cells="round",
    normalizer=FourBlockNorm(),
)
"""What all of them share; each preset below names its differences."""


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

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (16, 8), 31)
    """
    return replace(
        _UOCTTI,
        colour=colour,
        bins=2 * as_integer("orientations", orientations),
        vote=vote,
        cell_size=as_square_or_size("cell_size", cell_size),
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

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.aubry()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((5, 5), (26, 13), 9)
    """
    return replace(
        uoctti(cell_size, vote=vote, orientations=orientations, colour=colour),
        name="aubry",
        value_range=1.0,
        normalizer=FourBlockNorm(epsilon=0.1, parts=("undirected",)),
    )


def vlfeat(
    variant: Variant = "uoctti",
    *,
    cell_size: int = 8,
    orientations: int = 9,
    bilinear_orientations: bool = False,
) -> HOGSpec:
    """The descriptor that VLFeat's ``vl_hog`` returns (``vl/hog.c``), in (channels, rows, cols).

    For images in rows, as in C and in cyvlfeat with ``transposed=False``; MATLAB's has the axes exchanged.

    Args:
        variant: ``"uoctti"``, 3n + 4 channels; ``"dalaltriggs"``, 4n: the folded histogram, clipped, for each of the
            four blocks, which is not Dalal and Triggs's descriptor.
        cell_size: pixels of a cell.
        orientations: n, over 180°.
        bilinear_orientations: whether votes are shared by the two nearest bins, by an arccosine in float32.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.vlfeat()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (16, 8), 31)
    """
    parts: dict[Variant, tuple[Part, ...]] = {
        "uoctti": ("directed", "undirected", "texture"),
        "dalaltriggs": ("blocks",),
    }
    check_choice("variant", variant, Variant)
    is_bilinear = as_truth("bilinear_orientations", bilinear_orientations)
    return replace(
        _UOCTTI,
        name="vlfeat" if variant == "uoctti" else "vlfeat-dalaltriggs",
        bins=2 * as_integer("orientations", orientations) if variant == "uoctti" else orientations,
        signed=variant == "uoctti",
        vote="linear" if is_bilinear else "hard",
        cell_size=as_square_or_size("cell_size", cell_size),
        normalizer=FourBlockNorm(parts=parts[variant]),
        angle="vlfeat" if is_bilinear else "exact",
        layout="planes",
    )


def dpm(cell_size: int = 8) -> HOGSpec:
    """The descriptor of ``features.cc`` in voc-release5, which HOGgles uses, too: 18 + 9 + 4 channels and a zero.

    Grids have two rows and columns less than the image has cells.

    Args:
        cell_size: ``sbin``, pixels of a cell.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.dpm()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (14, 6), 32)
    """
    return replace(
        _UOCTTI,
        name="dpm",
        cell_size=as_square_or_size("cell_size", cell_size),
        normalizer=FourBlockNorm(parts=("directed", "undirected", "texture", "zero"), texture="dpm", outside="drop"),
        pooling=BilinearCells(beyond="repeat"),
        directions="four-decimals",
    )


def dlib(cell_size: int = 8) -> HOGSpec:
    """The descriptor that dlib's ``extract_fhog_features`` returns (``fhog.h``), without padding, in (31, rows, cols).

    Of two channels with the same gradient magnitude it takes the last in columns that it does eight at a time, the
    first in those left.  A build without vector instructions has other ties.

    Args:
        cell_size: pixels of a cell, at least 2: cells of one pixel are another descriptor in dlib.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.dlib()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (14, 6), 31)
    """
    cell_size = as_integer("cell_size", cell_size, most=LONGEST_SIDE)
    if cell_size < 2:
        raise ValueError("cell_size must be at least 2: dlib makes another descriptor of cells of one, got 1")
    return replace(
        _UOCTTI,
        name="dlib",
        cell_size=as_square_or_size("cell_size", cell_size),
        normalizer=FourBlockNorm(texture="dpm", outside="drop"),
        pooling=BilinearCells(beyond="drop"),
        colour_ties="dlib",
        directions="four-decimals",
        layout="planes",
    )


def piotr(cell_size: int = 8, *, orientations: int = 9, clip: float = 0.2) -> HOGSpec:
    """The descriptor of Piotr Dollár's ``fhog`` (``channels/private/gradientMex.cpp``): 3n + 4 channels and a zero.

    From reading; it was not run.  His arccosine comes from a table with steps of 1e-4, so that a gradient beside the
    boundary of two bins may be in the other.

    Args:
        cell_size: ``binSize``, pixels of a cell.
        orientations: n, over 180°.
        clip: upper bound of a normalised entry.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.piotr()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (16, 8), 32)
    """
    return replace(
        _UOCTTI,
        name="piotr",
        # his gradients are halved and his histograms divided by the pixels of a cell, but so is the root of his ε
        value_range=1.0,
        border="extrapolate",
        bins=2 * as_integer("orientations", orientations),
        cell_size=as_square_or_size("cell_size", cell_size),
        partial_cells="floor",
        normalizer=FourBlockNorm(clip=clip, parts=("directed", "undirected", "texture", "zero"), texture="dpm"),
        pooling=BilinearCells(beyond="drop", edge_gain=8 / 7),
        boundary="upper",
    )


def cnn_hog(cell_size: int = 8, *, orientations: int = 9, bilinear: bool = False) -> HOGSpec:
    """The HOG network of Mahendran and Vedaldi (``hog_net.m``): 3n channels of a gray image, in (channels, rows, cols).

    It sees a false edge around the image, beyond which it has middle gray, and outermost cells lie in fewer blocks.
    :class:`nablahog.paper.baselines.cnn_hog.CNNHOG` is the same with the network's own derivative.

    Args:
        cell_size: pixels of a cell, even.
        orientations: n, over 180°.
        bilinear: whether votes are shared by the two nearest bins (their HOGb).

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.cnn_hog()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (16, 8), 27)
    """
    bilinear, cell_size = as_truth("bilinear", bilinear), as_integer("cell_size", cell_size, most=LONGEST_SIDE)
    if cell_size % 2:
        raise ValueError(f"cell_size must be even, got {cell_size}")
    return replace(
        _UOCTTI,
        name="cnn-hogb" if bilinear else "cnn-hog",
        value_range=127.5,  # their gradients are halved
        colour="gray",
        border="gray",
        bins=2 * as_integer("orientations", orientations),
        vote="linear" if bilinear else "hard",
        cell_size=as_square_or_size("cell_size", cell_size),
        partial_cells="floor",
        normalizer=FourBlockNorm(epsilon=1e-6, floor=True, parts=("directed", "undirected"), outside="missing"),
        layout="planes",
    )


def seeing3d(cell_size: int = 5) -> HOGSpec:
    """The descriptor of ``features.cc`` by Aubry et al. ("Seeing 3D chairs"): 9 contrast-insensitive channels, ε = 0.1.

    Their search pads it with one empty cell on each side.  From reading; it was not run.  :func:`aubry` is what poses
    are found with here.

    Args:
        cell_size: ``sbin``, pixels of a cell.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.seeing3d()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((5, 5), (24, 11), 9)
    """
    return replace(
        _UOCTTI,
        name="seeing3d",
        value_range=1.0,
        bins=9,
        signed=False,
        cell_size=as_square_or_size("cell_size", cell_size),
        normalizer=FourBlockNorm(epsilon=0.1, parts=("undirected",), outside="drop"),
        pooling=BilinearCells(beyond="repeat"),
        directions="four-decimals",
    )
