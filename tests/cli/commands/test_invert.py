"""``nablahog invert``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

import nablahog
from nablahog import presets
from nablahog.cli.main import main
from nablahog.io.images import read_image

from ..common import FAST, SMALL, names


def test_invert(tmp_path: Path, photo: str, descriptor: str, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["invert", photo, descriptor, photo, "-o", str(tmp_path / "out"), *SMALL]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert f"Look at {tmp_path / 'out' / 'index.html'}" in printed.out
    page = (tmp_path / "out" / "index.html").read_text()
    assert "Pearson correlation" in page
    assert page.count("data:image/png;base64,") == 2 + 4 + 2 + 4  # the slider, and all of each input
    pictures = [f"{s}_{w}.png" for s in ("cat", "cat_2", "stored") for w in ("glyphs", "preimage", "thumbnails")]
    assert names(tmp_path / "out") == sorted([*pictures, "index.html", "results.json"])
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [result["input"] for result in results] == [photo, descriptor, photo]
    for result in results:
        assert result["descriptor"] == "uoctti"
        assert 0 < result["distance"] < 1
        assert read_image(tmp_path / "out" / result["preimage"]).shape[1:] == tuple(result["image_size"])
    known, unknown, _ = results
    assert all(isinstance(known[name], float) for name in ("cc", "mi", "ssim", "psnr"))
    assert unknown["cc"] is unknown["mi"] is unknown["ssim"] is unknown["psnr"] is None


def test_the_seed_decides(tmp_path: Path, photo: str) -> None:
    """Of a search that begins with noise."""
    made = []
    for seed in ("0", "0", "1"):
        assert main(["invert", photo, "-o", str(tmp_path / "out"), "--seed", seed, *FAST]) == 0
        made.append((tmp_path / "out" / "cat_preimage.png").read_bytes())
    assert made[0] == made[1] != made[2]


@pytest.mark.parametrize("quality", ["best", "fast"])
def test_quality(tmp_path: Path, photo: str, quality: str) -> None:
    spec, descriptor = presets.uoctti(8), nablahog.hog(read_image(photo)[None], presets.uoctti(8))
    expected = nablahog.reconstruct(descriptor, spec, (60, 80), prior="default", quality=quality)  # type: ignore[arg-type]
    assert main(["invert", photo, "--quality", quality, "-o", str(tmp_path / "out")]) == 0
    figures = json.loads((tmp_path / "out" / "results.json").read_text())
    assert figures[0]["distance"] == pytest.approx(float(expected.distance))


@pytest.mark.usefixtures("two_iterations")
def test_the_papers_search(tmp_path: Path, photo: str, descriptor: str) -> None:
    out = tmp_path / "out"
    assert main(["invert", photo, descriptor, "-o", str(out), "--method", "paper", "--size", "32"]) == 0
    assert {"cat_iterations.png", "stored_iterations.png", "cat_preimage.png"} <= {*names(out)}
    with Image.open(out / "cat_iterations.png") as sheet, Image.open(out / "stored_iterations.png") as unknown:
        assert sheet.width > unknown.width  # the photograph is shown where it is known
