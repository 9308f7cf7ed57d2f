"""The command as people use it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import torch
from PIL import Image

import nablahog
from nablahog import presets
from nablahog.cli.commands import demo
from nablahog.cli.main import main
from nablahog.cli.results import inversion
from nablahog.io.descriptor_file import load_descriptor
from nablahog.io.images import read_image

from .common import CHELSEA, FAST, SMALL, names


def test_hog_writes_the_descriptor_with_its_spec(tmp_path: Path, photo: str) -> None:
    out = tmp_path / "new" / "d.npz"
    assert main(["hog", photo, "-o", str(out)]) == 0
    stored = load_descriptor(out)
    assert stored.spec == presets.uoctti(8)
    assert stored.image_size == (60, 80)
    torch.testing.assert_close(stored.descriptor, nablahog.hog(read_image(photo)[None], stored.spec)[0])


def test_hog_options(tmp_path: Path, photo: str) -> None:
    for options, spec in [
        (["--descriptor", "paper", "--cell", "8x6"], presets.paper((8, 6))),
        (["--vote", "hard", "--cell", "4"], presets.uoctti(4, vote="hard")),
    ]:
        assert main(["hog", photo, "-o", str(tmp_path / "d.npz"), "--size", "64", *options]) == 0
        stored = load_descriptor(tmp_path / "d.npz")
        assert stored.spec == spec
        assert stored.image_size == (48, 64)


def test_hog_of_several_makes_a_folder(tmp_path: Path, photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "in2").mkdir()
    Image.fromarray(CHELSEA[:48, :64]).save(tmp_path / "in2" / "cat.jpg")
    assert main(["hog", photo, str(tmp_path / "in2" / "cat.jpg"), "-o", str(tmp_path / "out"), "--json"]) == 0
    assert names(tmp_path / "out") == ["cat.npz", "cat_2.npz"]
    rows = json.loads(capsys.readouterr().out)
    assert [row["output"] for row in rows] == [str(tmp_path / "out" / name) for name in ("cat.npz", "cat_2.npz")]
    assert rows[1]["shape"] == [6, 8, 31]
    assert load_descriptor(tmp_path / "out" / "cat_2.npz").image_size == (48, 64)


def test_hog_into_a_folder(tmp_path: Path, photo: str) -> None:
    assert main(["hog", photo, "-o", str(tmp_path / "new") + os.sep]) == 0
    assert main(["hog", photo, "-o", str(tmp_path / "new")]) == 0
    assert names(tmp_path / "new") == ["cat.npz"]


def test_glyph(tmp_path: Path, photo: str, descriptor: str) -> None:
    assert main(["glyph", photo, "-o", str(tmp_path / "g.png"), "--size", "64"]) == 0
    assert read_image(tmp_path / "g.png").shape == (1, 6 * 16, 8 * 16)
    assert main(["glyph", photo, descriptor, "-o", str(tmp_path / "out")]) == 0
    assert names(tmp_path / "out") == ["cat_glyphs.png", "stored_glyphs.png"]


def test_invert(tmp_path: Path, photo: str, descriptor: str, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["invert", photo, descriptor, photo, "-o", str(tmp_path / "out"), *SMALL]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "Pearson correlation" in printed.out
    pictures = [f"{s}_{w}.png" for s in ("cat", "cat_2", "stored") for w in ("glyphs", "preimage", "thumbnails")]
    assert names(tmp_path / "out") == sorted([*pictures, "results.json"])
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [result["input"] for result in results] == [photo, descriptor, photo]
    for result in results:
        assert {"input", "descriptor", "cc", "mi", "ssim", "distance", "seconds"} <= set(result)
        assert result["descriptor"] == "uoctti"
        assert result["image_size"] == [36, 48]
        assert 0 < result["distance"] < 1
        assert read_image(tmp_path / "out" / result["preimage"]).shape == (1, 36, 48)
    known, unknown, _ = results
    assert all(isinstance(known[name], float) for name in ("cc", "mi", "ssim"))
    assert unknown["cc"] is unknown["mi"] is unknown["ssim"] is None


def test_invert_prints_the_list_it_writes(tmp_path: Path, photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["invert", photo, "-o", str(tmp_path / "out"), "--json", *FAST]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "out" / "results.json").read_text())


def test_the_seed_decides(tmp_path: Path, photo: str) -> None:
    made = []
    for seed in ("0", "0", "1"):
        assert main(["invert", photo, "-o", str(tmp_path / "out"), "--seed", seed, *FAST]) == 0
        made.append((tmp_path / "out" / "cat_preimage.png").read_bytes())
    assert made[0] == made[1] != made[2]


def test_batches_hold_one_spec_and_size_and_not_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    def source(rows: int, spec: nablahog.HOGSpec) -> inversion.Source:
        size = (8 * rows, 8)
        return inversion.Source("p", "p", torch.zeros(rows, 1, spec.channels), spec, size, None)

    one, other = presets.paper(), presets.uoctti()
    sources = [source(1, one), source(2, one), source(1, other), source(1, one), source(1, one)]
    assert inversion.batches(sources) == [[0, 3, 4], [1], [2]]
    monkeypatch.setattr(inversion, "BATCH_PIXELS", 130)
    assert inversion.batches(sources) == [[0, 3], [4], [1], [2]]


def test_a_flat_photograph(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its descriptor is zero, to which no distance is relative: either a result without NaN, or one clear sentence."""
    Image.new("L", (32, 32), 128).save(tmp_path / "flat.png")
    for kind in ("paper", "uoctti"):
        status = main(["invert", str(tmp_path / "flat.png"), "-o", str(tmp_path / "out"), "--descriptor", kind, *SMALL])
        if status == 0:
            assert "NaN" not in (tmp_path / "out" / "results.json").read_text()
        else:
            assert capsys.readouterr().err.count("\n") == 1


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "SIZE", 64)
    assert main(["demo", "-o", str(tmp_path / "demo"), "--max-evaluations", "2"]) == 0
    assert f"Look at {tmp_path / 'demo' / 'index.html'}" in capsys.readouterr().out
    parts = ("difference", "glyphs", "preimage", "thumbnails")
    pictures = [f"{name}_{part}.png" for name in ("paper", "uoctti") for part in parts]
    assert names(tmp_path / "demo") == sorted([*pictures, "photograph.png", "figures.json", "index.html"])
    assert [row["descriptor"] for row in json.loads((tmp_path / "demo" / "figures.json").read_text())] == [
        "paper",
        "uoctti",
    ]
    html = (tmp_path / "demo" / "index.html").read_text()
    assert html.count("data:image/png;base64,") == 8
    assert "http" not in html.replace("http-equiv", "")


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("nablahog 0")
    for command in ([], ["hog"], ["glyph"], ["invert"], ["demo"], ["table1"], ["learn"], ["learn", "prior"]):
        assert main([*command, "--help"]) == 0
        assert "usage: nablahog" in capsys.readouterr().out


def test_invert_fast(tmp_path: Path, photo: str) -> None:
    spec, descriptor = presets.uoctti(8), nablahog.hog(read_image(photo)[None], presets.uoctti(8))
    expected = nablahog.reconstruct(descriptor, spec, (60, 80), quality="fast")
    assert main(["invert", photo, "--quality", "fast", "-o", str(tmp_path / "out")]) == 0
    figures = json.loads((tmp_path / "out" / "results.json").read_text())
    assert figures[0]["distance"] == pytest.approx(float(expected.distance))
    assert main(["invert", photo, "--quality", "good", "-o", str(tmp_path / "out")]) == 2
