"""`nablahog learn ridge` and `learn nearest`, the table with what they learn, and `learn hoggles` interrupted."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nablahog import presets
from nablahog.cli.commands import learn
from nablahog.cli.main import main
from nablahog.evaluate import learned
from nablahog.evaluate.photographs import sample_photographs
from nablahog.invert.baselines import hoggles_learning
from nablahog.invert.baselines.hoggles_learning import learn_hoggles
from nablahog.invert.baselines.nearest import NearestWindows
from nablahog.invert.baselines.ridge import RidgeRegression

from .common import CHELSEA, names

WRITTEN = {"ridge": "Regression in {}: {:,} weights, 3 images", "nearest": "Database in {}: 3 images"}
LOAD = {"ridge": RidgeRegression.load, "nearest": NearestWindows.load}
CELL = ["--cell", "4"]

both = pytest.mark.parametrize("kind", WRITTEN)


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Three small photographs."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(3):
        Image.fromarray(CHELSEA[5 * k : 5 * k + 40, 8 * k : 8 * k + 48]).save(folder / f"{k}.png")
    return str(folder)


@both
def test_learning(tmp_path: Path, images: str, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(images, "x.png").write_bytes(b"no image")
    Path(images, "notes.txt").touch()
    out = tmp_path / "new" / f"{kind}.npz"
    assert main(["learn", kind, "--images", images, "-o", str(out), *CELL, "--seed", "3", "--size", "44"]) == 0
    found = LOAD[kind](out)
    assert found.spec == presets.uoctti(4)
    assert (found.learning.images, found.learning.seed) == (("0.png", "1.png", "2.png"), 3)
    printed = capsys.readouterr()
    weights = found.weights.numel() if isinstance(found, RidgeRegression) else 0
    assert printed.out.splitlines() == [
        "Passed over: x.png: expected an image, got a file of no format that Pillow reads",
        "Passed over, as no images by their endings: notes.txt",
        WRITTEN[kind].format(out, weights),
    ]
    assert printed.err == ""
    assert names(out.parent) == [out.name]


@pytest.mark.usefixtures("here")
def test_the_table_with_them(
    tmp_path: Path, images: str, learned_files: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    files = [option for kind in WRITTEN for option in (f"--{kind}", learned_files[kind])]
    command = ["table1", "--images", images, "-o", str(out), "--methods", "ridge,nearest", "--limit", "2"]
    assert main([*command, *files]) == 0
    printed = capsys.readouterr()
    rows = [line.split(",")[:2] for line in (out / "per_image.csv").read_text().splitlines()[1:]]
    assert rows == [[kind, f"{k}.png"] for kind in WRITTEN for k in range(2)]
    assert all(kind in (out / "index.html").read_text() and kind in printed.out for kind in WRITTEN)
    assert printed.err == ""
    assert (out / "failures.csv").read_text() == "image,method,reason\n"


@pytest.mark.usefixtures("here")
def test_the_table_says_what_they_have_seen(tmp_path: Path, images: str, capsys: pytest.CaptureFixture[str]) -> None:
    database = str(tmp_path / "n.npz")
    assert main(["learn", "nearest", "--images", images, "-o", database]) == 0
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), "--methods", "nearest"]
    assert main([*command, "--nearest", database]) == 0
    remark = "The nearest file was learned from images of the same names as 3 of these"
    assert remark in capsys.readouterr().out


def test_files_of_another_kind(
    tmp_path: Path, images: str, photo: str, learned_files: dict[str, str], refused: Callable[..., None]
) -> None:
    ridge, nearest = learned_files["ridge"], learned_files["nearest"]
    table = ["table1", "--images", images, "-o", str(tmp_path / "out")]
    refused(
        *table, "--ridge", nearest, message=f"{nearest}: expected a ridge regression, but the archive lacks weights"
    )
    refused(*table, "--nearest", ridge, message="expected a database of windows, but the archive lacks pixels, sizes")
    refused(*table, "--ridge", photo, message=f"{photo}: expected a ridge regression (.npz), but it cannot be read")
    refused(*table, "--nearest", f"{nearest}x", message=f"{nearest}x: no such file")
    refused(*table, "--methods", "ridge", "--nearest", nearest, message="uses --nearest; these do: nearest")


@both
def test_other_cells(tmp_path: Path, images: str, kind: str, refused: Callable[..., None]) -> None:
    file = str(tmp_path / "four.npz")
    assert main(["learn", kind, "--images", images, "-o", file, *CELL]) == 0
    table = ["table1", "--images", images, "-o", str(tmp_path / "out"), f"--{kind}", file]
    message = "was learned for another spec: its cell_size is (4, 4), the uoctti descriptor's (8, 8)"
    refused(*table, message=message)
    refused(*table, message=f"{kind}: the ")


@both
def test_refuses(tmp_path: Path, images: str, kind: str, refused: Callable[..., None]) -> None:
    learn, to = ["learn", kind, "--images", images], ["-o", str(tmp_path / "x.npz")]
    what = {"ridge": "a regression", "nearest": "a database"}[kind]
    for output in ("x", "x.png", "images"):
        refused(*learn, "-o", str(tmp_path / output), message=f"{what} is one file: expected -o FILE.npz, got")
    refused(*learn, *to, "--cell", "64", message="no image is usable; the first: 0.png: expected at least 64x64 pixels")
    refused("learn", kind, "--images", f"{images}x", *to, message=f"{images}x: no such folder")
    refused(*learn, *to, "--seed", "-1", message="-1", status=2)


# --- interrupted


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dictionaries of a few atoms, kept every second iteration."""
    monkeypatch.setattr(hoggles_learning, "REPORTED", 2)
    monkeypatch.setattr(learn, "learn_pair", partial(learn_hoggles, atoms=20, iterations=7))


def _stop(done: int, total: int, what: str) -> None:
    if done == 5:
        raise KeyboardInterrupt


@pytest.mark.usefixtures("_small")
def test_hoggles_interrupted_and_repeated(
    tmp_path: Path, images: str, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., None]
) -> None:
    command = ["learn", "hoggles", "--images", images, *CELL, "-o"]
    out, undisturbed = tmp_path / "h.npz", tmp_path / "undisturbed.npz"
    assert main([*command, str(undisturbed)]) == 0
    with monkeypatch.context() as patched:
        patched.setattr(learn, "counter", lambda name: nullcontext(_stop))
        assert main([*command, str(out)]) == 130
    assert names(tmp_path) == ["h.npz.checkpoint", "images", "undisturbed.npz"]
    refused(*command, str(out), "--seed", "1", message=f"{out}.checkpoint: the checkpoint of another dictionary pair")
    assert main([*command, str(out)]) == 0
    assert names(tmp_path) == ["h.npz", "images", "undisturbed.npz"]
    with np.load(out, allow_pickle=False) as found, np.load(undisturbed, allow_pickle=False) as expected:
        assert set(found) == set(expected)
        for name in found:
            np.testing.assert_array_equal(found[name], expected[name])


def test_learning_for_the_table_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What nobody gave is learned once, however often that is interrupted."""
    monkeypatch.setattr(hoggles_learning, "REPORTED", 2)
    monkeypatch.setattr(learned, "learn_hoggles", partial(learn_hoggles, atoms=20, iterations=7))
    monkeypatch.setattr(learned, "sample_photographs", partial(sample_photographs, limit=2))
    monkeypatch.setattr(learned, "user_cache_path", lambda name: tmp_path / name)
    with pytest.raises(KeyboardInterrupt):
        learned.learned_from_samples("hoggles", _stop)
    (kept,) = names(tmp_path / "nablahog")
    assert kept.endswith(".npz.checkpoint")
    seen: list[int] = []
    path = learned.learned_from_samples("hoggles", lambda done, total, what: seen.append(done))
    assert seen == [0, 4, 5, 6, 7]
    assert names(tmp_path / "nablahog") == [path.name] == [kept.removesuffix(".checkpoint")]


@pytest.mark.usefixtures("_small")
def test_checkpoints_that_are_none(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    kept = tmp_path / "h.npz.checkpoint"
    kept.write_bytes(b"hello")
    command = ["learn", "hoggles", "--images", images, *CELL, "-o", str(tmp_path / "h.npz")]
    refused(*command, message=f"{kept}: expected a checkpoint of a dictionary pair")
    assert kept.read_bytes() == b"hello"
