"""What answers have in common: pictures and glyphs in JSON."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from torch import Tensor

from ..hog import HOGSpec
from ..io.images import Picture, to_pil
from ..viz.pictures import glyph_votes


def png(picture: Picture, opacity: Picture | None = None) -> bytes:
    """A picture in 0…1, with its opacity (H, W) if it is gray, as a PNG file."""
    file, image = io.BytesIO(), to_pil(picture)
    if opacity is not None:
        image.putalpha(to_pil(opacity))
    image.save(file, format="PNG", compress_level=1)  # for the loopback: fast, not small
    return file.getvalue()


def encoded(data: bytes) -> str:
    """Bytes as base64."""
    return base64.b64encode(data).decode("ascii")


def glyphs(descriptor: Tensor, spec: HOGSpec) -> dict[str, Any]:
    """The brightness of each stroke of a descriptor's glyphs (rows, cols, channels), as the page draws them."""
    votes, angles = glyph_votes(descriptor, spec)
    rows, cols, count = votes.shape
    return {
        "rows": rows,
        "cols": cols,
        "n": count,
        "cell": list(spec.cell_size),
        "angles": angles.tolist(),
        "votes": encoded(np.rint(votes * 255).astype(np.uint8).tobytes()),
    }
