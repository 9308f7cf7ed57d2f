"""The templates of pages and drawings, and pictures in them."""

from __future__ import annotations

import base64
import io
from functools import cache
from typing import TYPE_CHECKING

from ..io.images import Picture, to_pil

if TYPE_CHECKING:
    import jinja2


@cache
def environment() -> jinja2.Environment:
    """Escapes all that is inserted, and knows no undefined name."""
    import jinja2  # few commands need it

    loader, undefined = jinja2.PackageLoader("nablahog.viz"), jinja2.StrictUndefined
    return jinja2.Environment(loader=loader, undefined=undefined, autoescape=True, trim_blocks=True)


def png(picture: Picture) -> str:
    """A picture, as :func:`~nablahog.io.images.to_pil` takes it, as the text of a PNG in base64."""
    buffer = io.BytesIO()
    to_pil(picture).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode("ascii")
