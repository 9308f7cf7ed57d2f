"""`--prior`: inverting and the table with what `nablahog learn prior` wrote, or with what comes with the package."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nablahog.cli.main import main

from ..common import CHELSEA, names

ONCE = ["--epochs", "1"]
FEW = ["--max-evaluations", "3", "--size", "40"]


def _photographs(folder: Path) -> str:
    folder.mkdir()
    for k in range(3):
        Image.fromarray(CHELSEA[5 * k : 5 * k + 36, 8 * k : 8 * k + 40]).save(folder / f"{k}.png")
    return str(folder)


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Three small photographs."""
    return _photographs(tmp_path / "images")


def _prior(folder: Path, *options: str) -> str:
    path = folder / "prior.npz"
    assert main(["learn", "prior", "--images", _photographs(folder / "images"), "-o", str(path), *ONCE, *options]) == 0
    return str(path)


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The file that the command writes."""
    return _prior(tmp_path_factory.mktemp("signed"))


@pytest.fixture(scope="module")
def unsigned_prior(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same for unsigned descriptors."""
    return _prior(tmp_path_factory.mktemp("unsigned"), "--signs", "unsigned")


def _inverted(photo: str, out: Path, *options: str) -> tuple[bytes, float | None]:
    """The picture, and the confidence in its polarity."""
    assert main(["invert", photo, "-o", str(out), *FEW, *options]) == 0
    (result,) = json.loads((out / "results.json").read_text())
    return (out / result["preimage"]).read_bytes(), result["polarity"]


def test_inverting_with_it(
    tmp_path: Path, photo: str, descriptor: str, prior: str, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []
    for number, options in enumerate(([], ["--prior", prior])):
        out = tmp_path / f"out{number}"
        capsys.readouterr()
        assert main(["invert", photo, descriptor, "-o", str(out), *FEW, *options]) == 0
        assert capsys.readouterr().err == ""
        made.append([(out / f"{stem}_preimage.png").read_bytes() for stem in ("cat", "stored")])
    assert all(learned != plain for plain, learned in zip(made[0], made[1], strict=True))
    results = json.loads((tmp_path / "out1" / "results.json").read_text())
    assert all(0 < result["distance"] < 1 for result in results)


@pytest.mark.parametrize("preset", ["paper", "skimage", "opencv"])
def test_inverting_unsigned_descriptors_with_it(
    tmp_path: Path, photo: str, preset: str, unsigned_prior: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"shipped": [], "own": ["--prior", unsigned_prior], "none": ["--no-prior"]}
    made = {name: _inverted(photo, tmp_path / name, "--preset", preset, *more) for name, more in options.items()}
    out, err = capsys.readouterr()
    assert err == ""
    assert len({picture for picture, _ in made.values()}) == 3
    assert made["none"][1] is None
    assert all(0.5 <= confidence <= 1 for name, (_, confidence) in made.items() if name != "none" and confidence)
    assert made["shipped"][1] != made["own"][1]
    pages = {name: (tmp_path / name / "index.html").read_text() for name in options}
    assert "Probability that the pre-image is no negative" in pages["shipped"]
    assert "Probability that the pre-image is no negative" not in pages["none"]
    printed = {name: f"cat.png ({made[name][1]:.0%} sure)" in out for name in ("shipped", "own")}
    for name, said in printed.items():
        assert ("or its negative" in pages[name]) == said == (made[name][1] < 0.8)
    assert printed["own"]  # has hardly learned anything


@pytest.mark.parametrize("preset", ["uoctti", "dlib"])
def test_signed_descriptors_have_one_by_default(tmp_path: Path, photo: str, preset: str) -> None:
    options = ["--preset", preset]
    shipped, without = (
        _inverted(photo, tmp_path / name, *options, *more) for name, more in [("a", []), ("b", ["--no-prior"])]
    )
    assert shipped != without
    assert shipped[1] is without[1] is None


def test_an_installation_without_priors(
    tmp_path: Path,
    photo: str,
    images: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    refused: Callable[..., None],
) -> None:
    without = _inverted(photo, tmp_path / "without", "--preset", "paper", "--no-prior")
    capsys.readouterr()
    monkeypatch.setattr("nablahog.invert.learned.FOLDER", tmp_path)
    assert _inverted(photo, tmp_path / "missing", "--preset", "paper") == without
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("Inverting without a learned prior: this installation of nablahog has no unsigned.npz")
    message = "dalal-learned needs a file of unsigned-prior, see `nablahog learn prior --signs unsigned`"
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), "--methods"]
    refused(*command, "dalal-learned", message=message)


def test_samples(tmp_path: Path, photo: str, prior: str, refused: Callable[..., None]) -> None:
    out = tmp_path / "out"
    options = ["invert", photo, "-o", str(out), *FEW, "--samples", "2"]
    assert main([*options, "--preset", "paper"]) == 0
    (result,) = json.loads((out / "results.json").read_text())
    assert 0 < result["agreement"] < 1
    assert "cat_samples.png" in names(out)
    assert "sample 2" in (out / "index.html").read_text()
    assert main([*options[:3], str(tmp_path / "signed"), *options[4:], "--prior", prior]) == 0  # nothing is left open
    assert "cat_samples.png" not in names(tmp_path / "signed")
    for option in ("--no-prior", "--colour", "--method paper"):
        refused(*options, *option.split(), message=f"--samples and {option} exclude each other: samples are draws of a")


def test_both_options(tmp_path: Path, photo: str, prior: str, refused: Callable[..., None]) -> None:
    refused(
        "invert", photo, "-o", str(tmp_path / "out"), "--prior", prior, "--no-prior", message="not allowed", status=2
    )


def test_the_table_of_unsigned_descriptors(tmp_path: Path, images: str, unsigned_prior: str) -> None:
    tables = []
    for name, options in [("shipped", []), ("own", ["--unsigned-prior", unsigned_prior])]:
        command = ["table1", "--images", images, "-o", str(tmp_path / name), *FEW, "--workers", "1", "--limit", "1"]
        assert main([*command, "--methods", "dalal-learned,opencv-learned", *options]) == 0
        tables.append((tmp_path / name / "summary.csv").read_text())
        assert "opencv-learned,cc," in tables[-1]
    assert tables[0] != tables[1]


def test_the_table_with_it(tmp_path: Path, images: str, prior: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), *FEW, "--workers", "1", "--limit", "1"]
    assert main([*command, "--prior", prior, "--methods", "uoctti-learned"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "left out" not in printed.out
    remark = "The prior file was learned from images of the same names as 1 of these"
    html = (tmp_path / "out" / "index.html").read_text()
    assert remark in printed.out
    assert remark in html
    assert "uoctti-learned" in html
    assert len(names(tmp_path / "out" / "work" / "uoctti-learned")) == 1


@pytest.mark.usefixtures("here")
def test_the_table_without_it(
    tmp_path: Path,
    images: str,
    learned_files: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("nablahog.invert.learned.FOLDER", tmp_path)
    others = [option for kind, path in learned_files.items() for option in (f"--{kind}", path)]
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), *FEW, "--limit", "1"]
    assert main([*command, *others]) == 0
    remark = "uoctti-learned is optional, and runs with --prior FILE, see `nablahog learn prior`."
    assert remark in capsys.readouterr().out.splitlines()
    assert remark in (tmp_path / "out" / "index.html").read_text()
    assert "uoctti-learned" not in names(tmp_path / "out" / "work")
    assert main([*command, "--methods", "dalal-single"]) == 0
    assert remark not in capsys.readouterr().out  # nobody asked for it


def test_the_table_asked_for_it_without_a_prior(
    tmp_path: Path, images: str, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., None]
) -> None:
    monkeypatch.setattr("nablahog.invert.learned.FOLDER", tmp_path)
    options = ["--methods", "uoctti-single,uoctti-learned"]
    message = "uoctti-learned needs a file of prior, see `nablahog learn prior`"
    refused("table1", "--images", images, "-o", str(tmp_path / "out"), *options, message=message)


def test_priors_that_do_not_fit(tmp_path: Path, photo: str, prior: str, refused: Callable[..., None]) -> None:
    options = ["-o", str(tmp_path / "out"), "--prior", prior]
    message = f"{photo}: the prior was learned for signed descriptors, a paper descriptor is unsigned"
    refused("invert", photo, *options, "--descriptor", "paper", message=message)


def test_a_prior_of_the_other_kind(
    tmp_path: Path, images: str, unsigned_prior: str, refused: Callable[..., None]
) -> None:
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), "--prior", unsigned_prior]
    refused(*command, message="uoctti-learned: the prior was learned for unsigned descriptors, a uoctti descriptor is")


def test_damaged_priors(tmp_path: Path, images: str, photo: str, prior: str, refused: Callable[..., None]) -> None:
    whole = Path(prior).read_bytes()
    bad = tmp_path / "bad.npz"
    options = ["-o", str(tmp_path / "out"), "--prior", str(bad)]
    refused("invert", photo, *options, message=f"{bad}: no such file")
    refused("table1", "--images", images, *options, message=f"{bad}: no such file")
    for content, message in [
        (whole[: len(whole) // 2], "expected a learned prior (.npz), but it cannot be read"),
        (whole[:10_000] + b"\xff" * 100 + whole[10_100:], "the archive is damaged"),
        (b"hello", "expected a learned prior (.npz)"),
    ]:
        bad.write_bytes(content)
        refused("invert", photo, *options, message=f"{bad}: {message}")
        refused("table1", "--images", images, *options, message=f"{bad}: {message}")
    np.savez(bad, format=np.array([{}], dtype=object))
    refused("invert", photo, *options, message="expected a learned prior, but the archive lacks spec, widths")
