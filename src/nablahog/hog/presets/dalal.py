"""The HOG of the paper, and descriptors after Dalal and Triggs, as they and libraries compute them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from ...inputs.numbers import as_integer, as_number, as_square_or_size, as_truth, check_choice
from ..normalizers import BlockNorm, CellNorm, GlobalNorm
from ..normalizers.block import BlockForm
from ..normalizers.per_cell import GlobalForm
from ..poolings import BlockCells, BoxCells, PartialCells
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
    check_choice("global_form", global_form, GlobalForm)
    return HOGSpec(
        name="paper",
        value_range=1.0,
        colour="gray",
        border=border,
        bins=bins,
        signed=False,
        bin_offset=bin_offset,
        vote="linear",
        cell_size=as_square_or_size("cell_size", cell_size),
        partial_cells=partial_cells,
        normalizer=GlobalNorm(epsilon=epsilon, form=global_form),
    )


_DALAL_TRIGGS = replace(
    paper(),
    name="dalal-triggs",
    value_range=255.0,
    colour="largest",
    normalizer=BlockNorm((2, 2), step=(2, 2)),
)
"""What those after Dalal and Triggs share; each preset below names its differences."""


def dalal_triggs(
    cell_size: int | tuple[int, int] = 8, *, bins: int = 9, norm: BlockForm = "L2-Hys", epsilon: float = 1.0
) -> HOGSpec:
    """The person detector's HOG of Dalal and Triggs ("Histograms of Oriented Gradients for Human Detection", 2005).

    As the paper has it; its program was not run.  RGB with a root of all values, the channel of largest gradient,
    [-1, 0, 1], linear votes; blocks of 2x2 cells at a step of one cell, in each of which a Gaussian of σ half its side
    weighs the votes, and pixels vote bilinearly into its cells.

    Args:
        cell_size: pixels of a cell, one number or (height, width).
        bins: over 180°.
        norm: of a block (Section 6.4 of the paper).
        epsilon: ε, in votes of images in 0…255.  The paper's is "small", with the same results over a large range.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.dalal_triggs()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (15, 7), 36)
    """
    check_choice("norm", norm, BlockForm)
    cell = as_square_or_size("cell_size", cell_size)
    return replace(
        _DALAL_TRIGGS,
        bins=bins,
        cell_size=cell,
        normalizer=BlockNorm((2, 2), step=(2, 2), form=norm, epsilon=epsilon, epsilon_again=1e-3),
        pooling=BlockCells((2 * cell[0], 2 * cell[1]), cell, (cell[0] + cell[1]) / 2),
        gamma="sqrt",
    )


def skimage(
    orientations: int = 9,
    pixels_per_cell: tuple[int, int] = (8, 8),
    cells_per_block: tuple[int, int] = (3, 3),
    block_norm: BlockForm = "L2-Hys",
    *,
    transform_sqrt: bool = False,
    feature_vector: bool = True,
    channel_axis: int | None = None,
    value_range: float = 255.0,
) -> HOGSpec:
    """The descriptor that ``skimage.feature.hog`` returns (``feature/_hog.py``), with the names of its parameters.

    Args:
        orientations: bins over 180°.
        pixels_per_cell: (height, width).
        cells_per_block: (rows, cols).
        block_norm: ``"L1"``, ``"L1-sqrt"``, ``"L2"`` or ``"L2-Hys"``.
        transform_sqrt: whether to take the square root of the image first.
        feature_vector: whether the native layout is one row, or (rows, cols, rows of cells, columns of cells, bins).
        channel_axis: None: images are gray, and several channels become gray by Eq. 1.  Any other value: the channel
            of largest gradient; the value itself has no influence.
        value_range: 255 to match scikit-image on images of 8 bits, 1 on images in 0…1, because its ε is absolute.  In
            0…1, rounding decides ties of colours and bins; :func:`nablahog.compat.skimage.hog` rounds alike.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.skimage()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (14, 6), 81)
    """
    check_choice("block_norm", block_norm, BlockForm)
    return replace(
        _DALAL_TRIGGS,
        name="skimage",
        value_range=value_range,
        colour="gray" if channel_axis is None else "largest",
        bins=orientations,
        vote="hard",
        cell_size=as_square_or_size("pixels_per_cell", pixels_per_cell),
        normalizer=BlockNorm(as_square_or_size("cells_per_block", cells_per_block), form=block_norm),
        pooling=BoxCells(mean=True),
        gamma="sqrt" if as_truth("transform_sqrt", transform_sqrt) else "none",
        boundary="upper",
        layout="block-vector" if as_truth("feature_vector", feature_vector) else "blocks",
    )


def opencv(
    win_size: tuple[int, int] = (64, 128),
    block_size: tuple[int, int] = (16, 16),
    block_stride: tuple[int, int] = (8, 8),
    cell_size: tuple[int, int] = (8, 8),
    nbins: int = 9,
    *,
    win_sigma: float = -1,
    l2hys_threshold: float = 0.2,
    gamma: bool = True,
    signed: bool = False,
) -> HOGSpec:
    """The descriptor of ``cv2.HOGDescriptor.compute`` for a window (``hog.cpp``).  Sizes are (width, height), as there.

    An image is one window, of any size that holds a block.  Channels are in the order of the array, which decides
    ties of gradients.

    Args:
        win_size: pixels of the window that the other sizes must suit.
        block_size: pixels of a block, whole cells.
        block_stride: pixels from one block to the next; divides the window less a block.
        cell_size: pixels of a cell.
        nbins: bins over 180°, or 360° if signed.
        win_sigma: of the Gaussian over a block, pixels; 0 or less: a quarter of the mean of its sides.
        l2hys_threshold: the clip.  OpenCV keeps the first one of a process for all later descriptors.
        gamma: ``gammaCorrection``, the root of all values; on by default in OpenCV if no size is given.
        signed: ``signedGradient``.

    Raises:
        ValueError: the sizes do not suit each other.

    >>> spec = nablahog.presets.opencv()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (15, 7), 36)
    """
    win_sigma = as_number("win_sigma", win_sigma)
    sizes = {"win_size": win_size, "block_size": block_size, "block_stride": block_stride, "cell_size": cell_size}
    all_window, block, step, cell = (
        as_square_or_size(name, size, "width, height")[::-1] for name, size in sizes.items()
    )
    for window, b, s, c, axis in zip(all_window, block, step, cell, ("height", "width"), strict=True):
        if b > window or (window - b) % s or b % c:
            raise ValueError(
                f"along the {axis}, a block must be whole cells, and the window a block and whole strides, got a "
                f"window of {window}, a block of {b}, a stride of {s} and a cell of {c} pixels"
            )
    cells = block[0] // cell[0], block[1] // cell[1]
    return replace(
        _DALAL_TRIGGS,
        name="opencv",
        bins=nbins,
        signed=signed,
        cell_size=cell,
        normalizer=BlockNorm(
            cells,
            step=cells,
            epsilon=0.1 * cells[0] * cells[1] * replace(_DALAL_TRIGGS, bins=nbins).bins,  # after it was checked
            epsilon_again=1e-3,
            epsilon_outside_root=True,
            clip=l2hys_threshold,
        ),
        pooling=BlockCells(block, step, (block[0] + block[1]) / 8 if win_sigma <= 0 else win_sigma),
        gamma="sqrt" if as_truth("gamma", gamma) else "none",
        colour_ties="opencv",
        angle="opencv",
        layout="opencv-vector",
    )


def maskfeat(
    cell_size: int = 8,
    *,
    nbins: int = 9,
    gaussian_window: int = 16,
    layout: Literal["colour-planes", "tokens"] = "colour-planes",
) -> HOGSpec:
    """The descriptor of MaskFeat's ``HOGLayerC`` (SlowFast ``models/operators.py``), in (3, bins, rows, cols).

    The layer equals it on pixels in 0…255; on normalised ones its own rounding decides ties (``docs/libraries.md``).

    Args:
        cell_size: ``pool``, pixels of a cell.
        nbins: bins over 180°.
        gaussian_window: pixels of the side of a Gaussian that is tiled over the image and weighs its votes, 0 for none.
        layout: ``"colour-planes"``, or ``"tokens"``, that of the network's targets and predictions, a row for each
            patch of 2x2 cells: (196, 108) of an image of 224x224 (``_get_hog_label_2d``, and mmpretrain's
            ``HOGGenerator``).  :func:`nablahog.from_layout` folds predicted tokens into a descriptor.

    Raises:
        ValueError: a parameter is out of its range, as :class:`nablahog.HOGSpec` says.

    >>> spec = nablahog.presets.maskfeat()
    >>> spec.cell_size, spec.grid(128, 64), spec.channels
    ((8, 8), (16, 8), 27)
    >>> tokens = nablahog.presets.maskfeat(layout="tokens")
    >>> predicted = torch.rand(1, 196, 108)
    >>> nablahog.from_layout(predicted, tokens, (224, 224)).shape
    torch.Size([1, 28, 28, 27])
    """
    return replace(
        _DALAL_TRIGGS,
        name="maskfeat",
        colour="separate",
        bins=nbins,
        bin_offset=0.5 + as_integer("nbins", nbins) / 2,  # its angles begin at the vertical
        vote="hard",
        cell_size=as_square_or_size("cell_size", cell_size),
        normalizer=CellNorm(),
        pooling=BoxCells(window=gaussian_window),
        mask="sobel",
        counterclockwise=True,
        boundary="upper",
        layout=layout,
    )
