"""Pre-images in colour."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.hog import HOGSpec
from nablahog.hog.gradient import gray
from nablahog.invert import Search
from nablahog.invert.colour import reconstruct_colour

SPECS: dict[str, HOGSpec] = {
    "uoctti": presets.uoctti(4),
    "opencv": presets.opencv((40, 40), (8, 8), (4, 4), (4, 4)),
    "maskfeat": presets.maskfeat(4),
}


def two_colours() -> Tensor:
    """(1, 3, 40, 40): a red disc on a green ground of the same gray value, shaded."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, 40), torch.linspace(-1, 1, 40), indexing="ij")
    disc = torch.sigmoid(15 * (0.6 - torch.hypot(x, y)))
    shade = 0.1 * x
    return torch.stack([0.9 * disc, 0.45 * (1 - disc), 0.2 * torch.ones_like(x)])[None] + 0.1 + shade


@pytest.mark.parametrize("name", SPECS)
def test_colour_comes_closer(name: str) -> None:
    """Or stays gray: what OpenCV's largest channel jumps to and fro helps in half of all cases only."""
    spec = SPECS[name]
    descriptor = hog(two_colours().clamp(0, 1), spec)
    options: dict[str, Any] = {"seed": 1, "search": Search(max_evaluations=100)}
    plain = reconstruct(descriptor, spec, (40, 40), **options)
    result = reconstruct_colour(descriptor, spec, (40, 40), **options)
    assert result.image.shape == (1, 3, 40, 40)
    assert ((result.image >= 0) & (result.image <= 1)).all()
    assert (result.distance <= plain.distance).all()
    torch.testing.assert_close(
        result.distance,
        (hog(result.image, spec) - descriptor).flatten(1).norm(dim=1) / descriptor.flatten(1).norm(dim=1),
    )
    assert (result.evaluations > plain.evaluations).all()
    alike = torch.corrcoef(torch.stack([gray(result.image).flatten(), plain.image.flatten()]))[0, 1]
    assert alike > 0.8  # no stronger colours than the descriptor asks for
    coloured = (result.image - result.image.mean(dim=1, keepdim=True)).abs().max() > 1e-3
    assert coloured == (result.distance < plain.distance)
    assert coloured or name == "opencv"


def test_refusals() -> None:
    gray_only = presets.paper(4)
    with pytest.raises(ValueError, match="a paper descriptor is of gray images, and has no pre-image in colour"):
        reconstruct_colour(torch.rand(1, 5, 5, 9), gray_only)
