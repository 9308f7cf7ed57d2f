"""What a misspelt word was meant to be."""

from __future__ import annotations

import pytest

from nablahog.cli.arguments.did_you_mean import did_you_mean
from nablahog.cli.main import main


@pytest.mark.parametrize(
    ("argv", "meant"),
    [
        (["invrt", "a.png"], "'invert'"),
        (["invert_template", "a.npy"], "'invert-template'"),
        (["learn", "priors", "-o", "p.npz"], "'prior'"),
        (["hog", "a.png", "-o", "d", "--preset", "OpenCV"], "'opencv'"),
        (["hog", "a.png", "-o", "d", "--cells", "8"], "'--cell'"),
        (["table1", "-o", "t", "--methods", "uocti-single"], "'uoctti-single'"),
        (["table1", "-o", "t", "--methods", "dialect"], "'dialects'"),
        (["pose", "a.png", "--mesh", "m", "-o", "p", "--method", "exhaustiv"], "'exhaustive'"),
        (["hog", "a.png", "-o", "d", "--set", "orientation=8", "--preset", "skimage"], "'orientations'"),
    ],
)
def test_did_you_mean(argv: list[str], meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) in (1, 2)
    error = capsys.readouterr().err
    assert f"; did you mean {meant}?" in error
    assert error.count("\n") == 1


def test_what_is_like_nothing() -> None:
    assert did_you_mean("sift", ["hog", "invert"]) == ""
    assert did_you_mean("", []) == ""


def test_an_unknown_option_is_an_error_of_its_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["hog", "a.png", "-o", "d", "--wat"]) == 2
    assert capsys.readouterr().err.startswith(
        "nablahog hog: error: unrecognized arguments: --wat (see nablahog hog --h"
    )
