"""Pictures for people: HOG glyphs, differences, outlines, contact sheets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..hog import HOGSpec
from ..hog.dialects import as_spec
from ..hog.entries import CellAlignment, mean_over_colours, with_margin
from ..hog.orientation import bin_angles
from ..inputs.arrays import as_descriptors
from ..inputs.numbers import as_integer
from ..inputs.tensors import check_values
from ..io.images import Picture, as_array, to_pil
from ..runtime.pytorch import in_plain_mode

GLYPH_PIXELS, MOST_PIXELS = 16, 1024  # height of a cell of glyphs, and the most of it
STRIP_PIXELS = 2**21  # that are drawn at once, in float64
RED, BLUE = (1.0, 0.15, 0.1), (0.1, 0.6, 1.0)


def edge_votes(descriptor: Picture, spec: HOGSpec) -> tuple[NDArray[np.float64], NDArray[np.floating]]:
    """The strength of edges of each direction in each cell of the image, from a descriptor.

    Args:
        descriptor: (rows, cols, channels).
        spec: its dialect.

    Returns:
        The votes (rows, cols, n) and the gradient directions (n,) they stand for, in radians as in ``HOGSpec``.  A
        four-block descriptor gives its undirected channels, or else its directed ones, or else the mean over its
        blocks.  Any other gives all bins, averaged over blocks and colours.  Cells that a descriptor leaves out have no
        votes.

    Raises:
        ValueError: the shape is none of the spec's.
    """
    values, is_single = as_descriptors("the descriptor", descriptor)
    check_values("the descriptor", values)
    values = (values[0] if is_single else values).detach().cpu()
    if values.ndim != 3 or values.shape[2] != spec.channels:
        hint = "; nablahog.from_layout makes it of a library's own vector" if values.ndim < 3 else ""
        raise ValueError(
            f"expected a descriptor of shape (rows, cols, {spec.channels}), got {tuple(values.shape)}{hint}"
        )
    channels = mean_over_colours(values.permute(2, 0, 1).contiguous().unsqueeze(0), spec)
    votes = spec.normalizer.edge_strengths(channels, spec.bins, spec.signed)
    if spec.pooling.has_blocks:
        votes = CellAlignment(spec, spec.image_size(*values.shape[:2]), votes)(votes)
    votes = with_margin(votes, spec)
    return votes[0].permute(1, 2, 0).double().numpy(), bin_angles(spec)[: votes.shape[1]]


def _strokes(angles: NDArray[np.floating], height: int, width: int) -> NDArray[np.float64]:
    """(n, height, width) in 0…1: for each gradient direction a line through the middle, perpendicular to it."""
    y = np.arange(height)[:, None] - (height - 1) / 2
    x = np.arange(width)[None, :] - (width - 1) / 2
    cos, sin = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    across = np.abs(x * cos + y * sin)  # y and the angles both grow downwards: no flip
    along = np.abs(y * cos - x * sin)
    half_width, half_length = max(0.5, min(height, width) / 24), min(height, width) / 2 - 0.5
    strokes: NDArray[np.float64] = np.clip(half_width + 0.5 - across, 0, 1) * np.clip(half_length + 0.5 - along, 0, 1)
    return strokes


@in_plain_mode
def glyphs(descriptor: Picture, spec: HOGSpec | str, cell_pixels: int = GLYPH_PIXELS) -> NDArray[np.float64]:
    """The usual picture of a HOG: in each cell, for each orientation, a stroke along the edge.

    A stroke is perpendicular to its gradient, so a vertical edge is a vertical stroke.  Its
    brightness is the vote; where strokes cross, the brighter one shows.  Votes that only 5 % of the non-empty
    cells reach are white, because globally normalised descriptors have a few votes far above all others.

    Args:
        descriptor: (rows, cols, channels), tensor or array; values below 0 are drawn as 0.
        spec: its dialect, or the name of a preset with its defaults.
        cell_pixels: height of a cell in the picture; its width follows from the shape of the spec's cells.

    Returns:
        (rows · cell height, cols · cell width) for the cells of the image, float64 in 0…1; black for an all-zero
        descriptor, and where cells are left out.

    Raises:
        ValueError: the spec has no descriptor of that shape; ``cell_pixels`` is not in 1…1024; or there is no such
            preset.

    >>> spec = nablahog.presets.uoctti(cell_size=8)
    >>> descriptor = nablahog.hog(np.eye(64, 48, dtype=np.float32), spec)
    >>> nablahog.glyphs(descriptor, spec).shape  # 8x6 cells of 16x16 pixels
    (128, 96)
    """
    return _draw_cells(*_votes_and_strokes(descriptor, as_spec(spec), cell_pixels))


def glyph_image(descriptor: Picture, spec: HOGSpec, cell_pixels: int = GLYPH_PIXELS) -> Image.Image:
    """:func:`glyphs` as an 8-bit image, drawn in strips to save memory."""
    votes, strokes = _votes_and_strokes(descriptor, spec, cell_pixels)
    rows, cols, _ = votes.shape
    _, _, across = strokes.shape
    image = Image.new("L", (cols * across, rows * cell_pixels))
    step = max(1, STRIP_PIXELS // (cols * across * cell_pixels))
    for top in range(0, rows, step):
        image.paste(to_pil(_draw_cells(votes[top : top + step], strokes)), (0, top * cell_pixels))
    return image


def _votes_and_strokes(
    descriptor: Picture, spec: HOGSpec, cell_pixels: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The votes (rows, cols, n) in 0…1 and the strokes (n, height, width) of a cell in the picture."""
    cell_pixels = as_integer("cell_pixels", cell_pixels, most=MOST_PIXELS)
    votes, angles = edge_votes(descriptor, spec)
    strongest = votes.max(axis=2, initial=0.0)
    if strongest.any():
        votes = votes / np.quantile(strongest[strongest > 0], 0.95)
    return votes.clip(0, 1), _strokes(angles, cell_pixels, cell_width(spec, cell_pixels))


def cell_width(spec: HOGSpec, cell_pixels: int) -> int:
    """The width of a cell of glyphs that is ``cell_pixels`` high."""
    return max(1, round(cell_pixels * spec.cell_size[1] / spec.cell_size[0]))


def _draw_cells(votes: NDArray[np.float64], strokes: NDArray[np.float64]) -> NDArray[np.float64]:
    rows, cols, _ = votes.shape
    _, down, across = strokes.shape
    picture = np.zeros((down * across, rows * cols))  # pixels of a cell first: one stroke covers few of them
    for k, stroke in enumerate(strokes.reshape(len(strokes), -1)):
        (covered,) = stroke.nonzero()
        picture[covered] = np.maximum(picture[covered], np.outer(stroke[covered], votes[..., k]))
    cells = picture.reshape(down, across, rows, cols).transpose(2, 0, 3, 1)
    drawn: NDArray[np.float64] = cells.reshape(rows * down, cols * across)
    return drawn


def difference(picture: Picture, reference: Picture) -> NDArray[np.float64]:
    """(picture - reference) / 2 + ½, both (H, W) in 0…1: gray where they agree, bright where the first is brighter."""
    a, b = as_array(picture), as_array(reference)
    if a.shape != b.shape:
        raise ValueError(f"expected two pictures of one shape, got {a.shape} and {b.shape}")
    return (a - b) / 2 + 0.5


def fade_unsure(picture: Picture, confidence: Picture, sure: float) -> NDArray[np.float64]:
    """A picture (H, W) in 0…1, the grayer the lower the confidence (H, W) that its brightness is right.

    It has its own contrast where the confidence is at least ``sure``, and its mean where it is at most 0.5: what is
    surely wrong is not shown either.
    """
    image, chances = as_array(picture), as_array(confidence)
    contrast = np.clip((chances - 0.5) / (sure - 0.5), 0, 1)
    faded: NDArray[np.float64] = image.mean() + contrast * (image - image.mean())
    return faded


def outlined(picture: Picture, inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """A picture (1 or 3, H, W) in 0…1 as (3, H, W) with the outline of a region (H, W) in red, two pixels wide."""
    from scipy import ndimage  # a sixth of a second, which only poses need

    drawn: NDArray[np.float64] = np.broadcast_to(as_array(picture), (3, *inside.shape)).copy()
    line = ndimage.binary_dilation(inside) & ~ndimage.binary_erosion(inside, border_value=1)
    drawn[:, line] = np.array(RED)[:, None]
    return drawn


@dataclass(frozen=True)
class Panel:
    """A picture, (H, W), (1, H, W) or (3, H, W) in 0…1, its caption, and a text for those who cannot see it."""

    picture: Picture
    caption: str
    alt: str = ""


def contact_sheet(rows: Sequence[Sequence[Panel]], height: int = 256, margin: int = 8) -> Image.Image:
    """Rows of pictures on white, each under its caption, all scaled to one height in pixels, as an 8-bit RGB image."""
    if not rows or not all(rows):
        raise ValueError("a contact sheet needs at least one row, and each row at least one panel")
    font = ImageFont.load_default(max(11, height // 16))
    line = math.ceil(font.getbbox("Ág")[3]) + margin // 2
    pictures = [[_scale_to(panel.picture, height) for panel in row] for row in rows]
    columns = [max(row[c].width for row in pictures if c < len(row)) for c in range(max(len(row) for row in pictures))]
    lefts = [margin + sum(columns[:c]) + c * margin for c in range(len(columns))]
    size = (lefts[-1] + columns[-1] + margin, margin + len(rows) * (line + height + margin))
    sheet = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(sheet)
    for r, row in enumerate(rows):
        top = margin + r * (line + height + margin)
        for panel, picture, left, width in zip(row, pictures[r], lefts, columns, strict=False):
            draw.text((left, top), _shorten(panel.caption, font, width), fill="black", font=font)
            sheet.paste(picture, (left, top + line))
    return sheet


def _scale_to(picture: Picture, height: int) -> Image.Image:
    image = to_pil(picture).convert("RGB")
    if image.height == height:
        return image
    # enlarged pixels stay square: no structure is invented
    how = Image.Resampling.NEAREST if height > image.height else Image.Resampling.LANCZOS
    return image.resize((max(1, round(image.width * height / image.height)), height), how)


def _shorten(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> str:
    """``text``, its end cut off where it would be wider than ``width`` pixels."""
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…"
