"""`--prior`: inverting and the table with what `nablahog learn prior` wrote."""

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


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The file that the command writes."""
    folder = tmp_path_factory.mktemp("learned")
    path = folder / "prior.npz"
    assert main(["learn", "prior", "--images", _photographs(folder / "images"), "-o", str(path), *ONCE]) == 0
    return str(path)


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
    tmp_path: Path, images: str, learned_files: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    others = [option for kind, path in learned_files.items() for option in (f"--{kind}", path)]
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), *FEW, "--limit", "1"]
    assert main([*command, *others]) == 0
    remark = "uoctti-learned is optional, and runs with --prior FILE, see `nablahog learn prior`."
    assert remark in capsys.readouterr().out.splitlines()
    assert remark in (tmp_path / "out" / "index.html").read_text()
    assert "uoctti-learned" not in names(tmp_path / "out" / "work")
    assert main([*command, "--methods", "dalal-single"]) == 0
    assert remark not in capsys.readouterr().out  # nobody asked for it


def test_the_table_asked_for_it_without_a_prior(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    options = ["--methods", "uoctti-single,uoctti-learned"]
    message = "uoctti-learned needs --prior FILE, see `nablahog learn prior`"
    refused("table1", "--images", images, "-o", str(tmp_path / "out"), *options, message=message)


def test_priors_that_do_not_fit(tmp_path: Path, photo: str, prior: str, refused: Callable[..., None]) -> None:
    options = ["-o", str(tmp_path / "out"), "--prior", prior]
    refused("invert", photo, *options, "--cell", "4", message=f"{photo}: the prior was learned for another spec: its ")
    refused("invert", photo, *options, "--descriptor", "paper", message="for another spec")
    refused("invert", photo, *options, "--vote", "hard", message="its vote is 'linear', the uoctti descriptor's 'hard'")


def test_priors_for_other_cells(
    tmp_path: Path, images: str, photo: str, descriptor: str, refused: Callable[..., None]
) -> None:
    other = tmp_path / "other.npz"
    assert main(["learn", "prior", "--images", images, "-o", str(other), *ONCE, "--cell", "2"]) == 0
    options = ["-o", str(tmp_path / "out"), "--prior", str(other)]
    message = "the prior was learned for another spec: its cell_size is (2, 2), the uoctti descriptor's (8, 8)"
    refused("invert", descriptor, *options, message=f"{descriptor}: {message}")
    refused("table1", "--images", images, *options, message=f"uoctti-learned: {message}")


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
