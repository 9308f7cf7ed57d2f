"""One request as the command and as Python have it."""

from __future__ import annotations

from nablahog.cli.arguments.options import build_request
from nablahog.cli.main import parser
from nablahog.requests.inversion import InvertRequest
from nablahog.requests.options import words


def test_a_request() -> None:
    request = InvertRequest(quality="fast", size=64)
    assert words(request, InvertRequest) == ["--size", "64", "--quality", "fast"]
    arguments = parser().parse_args(["invert", "photo.png", "-o", "out", "--size", "64", "--quality", "fast"])
    assert build_request(InvertRequest, arguments) == request
