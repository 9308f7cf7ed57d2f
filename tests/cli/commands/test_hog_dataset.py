"""`nablahog hog … -o NAME.parquet`: all images, once each, even if a run is interrupted."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import hog, presets
from nablahog.cli.commands import hog as command
from nablahog.cli.main import main
from nablahog.io.descriptor_dataset import DescriptorDataset
from nablahog.io.images import read_image
from nablahog.jobs import describing

from ...paper.common import run_in_this_process
from ..common import names


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three images a file."""
    run_in_this_process(monkeypatch)
    monkeypatch.setattr(command, "SHARD", 3)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Seven images of two sizes, and one that is none."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for k in range(7):
        levels = np.random.default_rng(k).integers(0, 256, (40 + 8 * (k % 2), 48), dtype=np.uint8)
        Image.fromarray(levels).save(folder / f"{k}.png")
    (folder / "x.png").write_bytes(b"no image")
    return folder


def test_all_images(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.parquet"
    assert main(["hog", str(photos), "-o", str(out), "--preset", "dpm"]) == 3
    printed = capsys.readouterr()
    assert printed.out == f"7 of 8 images in {out}\n"
    assert "x.png: expected an image" in printed.err
    assert names(out) == [f"part-00000{k}.parquet" for k in range(3)]
    data = DescriptorDataset(str(out))
    assert [Path(row.path).name for row in data] == [*(f"{k}.png" for k in range(7)), "x.png"]
    for row in data[:7]:
        expected = hog(read_image(row.path)[None], presets.dpm())[0]
        assert torch.equal(row.stored.descriptor, expected)


def test_what_is_done_is_kept(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.parquet"
    command = ["hog", str(photos), "-o", str(out), "--quiet"]
    main(command)
    whole = [(out / name).read_bytes() for name in names(out)]
    (out / names(out)[1]).unlink()
    (out / names(out)[-1]).write_bytes(b"cut off")
    done: list[str] = []
    write = describing.write_shard
    monkeypatch.setattr(describing, "write_shard", lambda url, *rest: (done.append(Path(url).name), write(url, *rest)))
    main(command)
    assert sorted(done) == ["part-000001.parquet", "part-000002.parquet"]
    assert [(out / name).read_bytes() for name in names(out)] == whole


def test_lists_patterns_and_urls(photos: Path, tmp_path: Path) -> None:
    lines = ["# some of them", f'"{photos / "2.png"}"', "", str(photos / "[5].png")]
    (tmp_path / "list.txt").write_text("\n".join(lines), encoding="utf-16")
    inputs = [str(photos / "[01].png"), (photos / "3.png").as_uri(), f"@{tmp_path / 'list.txt'}"]
    assert main(["hog", *inputs, "-o", str(tmp_path / "o.parquet"), "--quiet"]) == 0
    assert [Path(row.path).name for row in DescriptorDataset(str(tmp_path / "o.parquet"))] == [
        f"{k}.png" for k in (0, 1, 3, 2, 5)
    ]


def test_archives_and_brackets(photos: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "photos.zip", "w") as archive:
        for k in (0, 1):
            archive.write(photos / f"{k}.png", f"in/{k + 9}.png")
        archive.writestr("in/._9.png", "of a Mac")
        archive.write(photos / "2.png", "b[1].png")
    name, bracket = (f"zip://{each}.png::{tmp_path / 'photos.zip'}" for each in ("in/*", "b[1]"))
    out = str(tmp_path / "run[1].parquet")
    for _ in range(2):  # the second time there is nothing to do
        assert main(["hog", name, bracket, "-o", out, "--quiet"]) == 0
    rows = list(DescriptorDataset(out))
    assert [row.path.partition("::")[0] for row in rows] == ["zip://in/9.png", "zip://in/10.png", "zip://b[1].png"]
    assert all(row.error is None for row in rows)


def test_links_of_a_chain(photos: Path, tmp_path: Path) -> None:
    """The path is put where it was, though its letters stand elsewhere in the URL, too."""
    with zipfile.ZipFile(tmp_path / "p.zip", "w") as archive:
        archive.write(photos / "0.png", "p/0.png")
    cached = f"filecache::{photos.as_uri()}/[01].png"
    out = str(tmp_path / "o.parquet")
    assert main(["hog", f"zip://p::{tmp_path / 'p.zip'}", cached, "-o", out, "--quiet"]) == 0
    assert [Path(row.path.partition(".png")[0]).name for row in DescriptorDataset(out)] == ["0", "0", "1"]


def test_what_it_refuses(photos: Path, tmp_path: Path, refused: Callable[..., None]) -> None:
    one, other, bad, out = (
        str(tmp_path / name) for name in ("photos/0.png", "photos/1.png", "photos/x.png", "o.parquet")
    )
    assert main(["hog", *[one] * 4, "-o", out, "--quiet"]) == 0
    refused("hog", *[other] * 4, "-o", out, message="has other images, or another kind of descriptor")
    refused("hog", *[one] * 4, "-o", out, "--preset", "dpm", message="expected another -o")
    refused("hog", one, "-o", out, message="holds 1 shard of other images")
    refused("hog", f"zip://*.png::{bad}", "-o", str(tmp_path / "q.parquet"), message="File is not a zip file")
    refused("hog", bad, "-o", str(tmp_path / "q.parquet"), message="no image of 1 has a descriptor")
    (tmp_path / "s.parquet").write_bytes(b"x")
    refused("hog", one, "-o", str(tmp_path / "s.parquet"), message="expected a folder for the data set")
    refused("hog", one, "-o", "nostore://x.parquet", message="nostore://x.parquet: Protocol not known")
    refused("hog", one, "-o", str(tmp_path / "a.npz"), "--workers", "2", message="--workers goes with a data set")


def test_a_cluster_without_dask(
    photos: Path, tmp_path: Path, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "nablahog.jobs.cluster", raising=False)
    monkeypatch.setitem(sys.modules, "dask", None)
    out = str(tmp_path / "o.parquet")
    message = "a cluster needs dask: pip install dask distributed"
    refused("hog", str(photos / "0.png"), "-o", out, "--cluster", "local:1", message=message)
