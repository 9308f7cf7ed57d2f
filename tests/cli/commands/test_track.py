"""`nablahog track` on a folder of frames."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from nablahog.cli.main import main
from nablahog.io.images import write_image
from tests.pose.common import WOODEN, degrees_between, model
from tests.pose.test_tracker import empty, frame, true_pose

from ..common import names
from .test_pose import write_off


@pytest.fixture
def video(tmp_path: Path) -> list[str]:
    """The arguments of four frames, the last of them without the chair."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(4):
        write_image(folder / f"{k}.png", frame(k) if k < 3 else empty())
    write_off(tmp_path / "wooden.off", model(WOODEN))
    return [
        "track",
        str(folder),
        "--mesh",
        str(tmp_path / "wooden.off"),
        "-o",
        str(tmp_path / "out"),
        "--init",
        "40,15",
    ]


def test_a_pose_a_frame(tmp_path: Path, video: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*video, "--focal", "300"]) == 0
    assert "The object is seen in 3 of 4 frames" in capsys.readouterr().out
    assert names(tmp_path / "out") == ["index.html", "poses.csv", "poses.json"]
    rows = list(csv.DictReader((tmp_path / "out" / "poses.csv").read_text().splitlines()))
    assert [row["image"] for row in rows] == ["0.png", "1.png", "2.png", "3.png"]
    for k, row in enumerate(rows[:3]):
        assert degrees_between(float(row["azimuth"]), float(true_pose(k)[0, 0])) < 4
        assert row["model"] == "wooden"
    assert rows[3]["error"] == "the object is not seen"
    whole = json.loads((tmp_path / "out" / "poses.json").read_text())
    assert [len(whole["annotations"]), len(whole["failed"])] == [3, 1]
    assert {each["focal_length_from"] for each in whole["annotations"]} == {"given"}


def test_refuses(tmp_path: Path, video: list[str], refused: Callable[..., None]) -> None:
    write_off(tmp_path / "frames" / "other.off", model(WOODEN))
    write_off(tmp_path / "frames" / "one.off", model(WOODEN))
    refused(*video, "--mesh", str(tmp_path / "frames"), message="expected the model of the object, got 2 models")
    refused(*video, "--focal", "exif", message="its EXIF data has no focal length")
    write_image(tmp_path / "frames" / "1.png", torch.zeros(1, 20, 30))
    refused(*video, message="1.png: expected a frame of 150x180 pixels, as the first one, got 20x30")
