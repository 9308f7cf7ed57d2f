"""`--prior`: inversion and Table 1 with a learned prior, with those of the package, and without any."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from nablahog import presets
from nablahog.cli.main import main

from ...paper.common import write_prior
from ..common import SMALL, names


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_prior(tmp_path_factory.mktemp("signed") / "p.npz", presets.uoctti(), images=["0.png"]))


@pytest.fixture(scope="module")
def unsigned_prior(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_prior(tmp_path_factory.mktemp("unsigned") / "p.npz", presets.paper(), images=["0.png"]))


def _inverted(photo: str, out: Path, *options: str) -> tuple[bytes, float | None]:
    """The picture, and the confidence in its polarity."""
    assert main(["invert", photo, "-o", str(out), *SMALL, *options]) == 0
    (result,) = json.loads((out / "results.json").read_text())
    return (out / result["preimage"]).read_bytes(), result["polarity"]


def test_signed_descriptors(tmp_path: Path, photo: str, prior: str) -> None:
    options: tuple[list[str], ...] = ([], ["--prior", prior], ["--prior", "none"])
    made = [_inverted(photo, tmp_path / str(k), *more) for k, more in enumerate(options)]
    assert len({picture for picture, _ in made}) == 3
    assert [polarity for _, polarity in made] == [None] * 3


@pytest.mark.slow
def test_unsigned_descriptors(
    tmp_path: Path, photo: str, unsigned_prior: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"shipped": [], "own": ["--prior", unsigned_prior], "none": ["--prior", "none"]}
    made = {name: _inverted(photo, tmp_path / name, "--preset", "paper", *more) for name, more in options.items()}
    out, err = capsys.readouterr()
    assert err == ""
    assert len({picture for picture, _ in made.values()}) == 3
    assert made["none"][1] is None
    for name in ("shipped", "own"):
        page, sure = (tmp_path / name / "index.html").read_text(), made[name][1]
        assert sure is not None
        assert 0.5 <= sure <= 1
        assert ("or its negative" in page) == (f"cat.png ({1 - sure:.0%})" in out) == (sure < 0.8)
        assert "gray where unsure" in page
        assert "cat_regions.png" in names(tmp_path / name)
    assert "cat_regions.png" not in names(tmp_path / "none")


def test_an_installation_without_priors(
    tmp_path: Path,
    photo: str,
    images: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    refused: Callable[..., None],
) -> None:
    without = _inverted(photo, tmp_path / "without", "--preset", "paper", "--prior", "none")
    capsys.readouterr()
    monkeypatch.setattr("nablahog.invert.prior.choice.PRIOR_FOLDER", tmp_path)
    assert _inverted(photo, tmp_path / "missing", "--preset", "paper") == without
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("Inverting without a learned prior: this installation of nablahog has no unsigned.npz")
    message = "dalal-learned needs a file of unsigned-prior, see `nablahog learn prior --signs unsigned`"
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), "--methods", "dalal-learned"]
    refused(*command, message=message, status=2)


@pytest.mark.slow
def test_samples(tmp_path: Path, photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    options = ["invert", photo, *SMALL, "--samples", "2", "-o"]
    assert main([*options, str(out), "--preset", "paper"]) == 0
    (result,) = json.loads((out / "results.json").read_text())
    assert 0 < result["agreement"] < 1
    assert "cat_samples.png" in names(out)
    assert "sample 2" in (out / "index.html").read_text()
    assert "No samples" not in capsys.readouterr().out
    assert main([*options, str(tmp_path / "signed")]) == 0  # these leave nothing open
    assert "No samples" in capsys.readouterr().out
    assert "cat_samples.png" not in names(tmp_path / "signed")


@pytest.mark.slow
def test_the_table(
    tmp_path: Path, images: str, prior: str, unsigned_prior: str, here: None, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = []
    own = ["--learned", f"prior={prior}", "--learned", f"unsigned-prior={unsigned_prior}"]
    for name, options in [("shipped", []), ("own", own)]:
        command = ["table1", "--images", images, "-o", str(tmp_path / name), "--limit", "1", "--max-evaluations", "3"]
        assert main([*command, "--methods", "uoctti-learned,dalal-learned", *options]) == 0
        tables.append((tmp_path / name / "summary.csv").read_text())
    assert tables[0] != tables[1]
    assert "The prior file was learned from images of the same names as 1 of these" in capsys.readouterr().out


def test_priors_that_do_not_fit(
    tmp_path: Path, photo: str, images: str, prior: str, unsigned_prior: str, refused: Callable[..., None]
) -> None:
    to = ["-o", str(tmp_path / "out")]
    message = f"{photo}: the prior is for signed descriptors, but a paper descriptor is unsigned"
    refused("invert", photo, *to, "--prior", prior, "--preset", "paper", message=message)
    table = ["table1", "--images", images, *to, "--learned"]
    refused(*table, f"prior={unsigned_prior}", message="uoctti-learned: the prior is for unsigned descriptors")
    (tmp_path / "bad.npz").write_bytes(Path(prior).read_bytes()[:1000])
    refused("invert", photo, *to, "--prior", str(tmp_path / "bad.npz"), message="bad.npz: ")
    refused(*table, f"prior={tmp_path / 'bad.npz'}", message="bad.npz: ")
