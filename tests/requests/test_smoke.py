"""One request as the command and as Python have it, and the descriptor that it asks for."""

from __future__ import annotations

import pytest
import torch

from nablahog import presets
from nablahog.cli.arguments.options import build_request
from nablahog.cli.main import parser
from nablahog.requests.inversion import InvertRequest
from nablahog.requests.options import words
from nablahog.requests.sources import from_photo


def test_a_request() -> None:
    request = InvertRequest(quality="fast", size=64)
    assert words(request, InvertRequest) == ["--size", "64", "--quality", "fast"]
    arguments = parser().parse_args(["invert", "photo.png", "-o", "out", "--size", "64", "--quality", "fast"])
    assert build_request(InvertRequest, arguments) == request


@pytest.mark.parametrize(("size", "how"), [(0, ""), (256, " after shrinking it to 256 pixels")])
def test_a_photograph_without_a_cell(size: int, how: str) -> None:
    with pytest.raises(ValueError, match=f"^a.png: .*{how}$") as caught:
        from_photo("a.png", "a", torch.rand(1, 300, 3), presets.vlfeat(), size=size)
    assert ("after" in str(caught.value)) == bool(how)
