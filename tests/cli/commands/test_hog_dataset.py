"""`nablahog hog … -o NAME.parquet`: all images, once each, even if a run is interrupted."""

from __future__ import annotations

import shlex
import zipfile
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import fsspec
import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import hog, presets
from nablahog.cli.image_lists import list_images
from nablahog.cli.main import main
from nablahog.io.dataset_manifest import MANIFEST
from nablahog.io.descriptor_dataset import DescriptorDataset
from nablahog.io.images import read_image
from nablahog.jobs import describing
from nablahog.runtime import cache

from ...paper.common import run_in_this_process
from ..common import names


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_this_process(monkeypatch)


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
    assert names(out) == [MANIFEST, *(f"part-00000{k}.parquet" for k in range(3))]
    data = DescriptorDataset(str(out))
    assert [Path(row.path).name for row in data] == [*(f"{k}.png" for k in range(7)), "x.png"]
    for row in data[:7]:
        expected = hog(read_image(row.path)[None], presets.dpm())[0]
        assert torch.equal(row.stored.descriptor, expected)
    assert main(["glyph", str(out), "-o", str(tmp_path / "glyphs")]) == 1  # it reads no data sets


def test_colours_that_scikit_image_would_use_are_named(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["hog", str(photos / "*.png"), "-o", str(tmp_path / "out.parquet"), "--preset", "skimage"]
    for count in (1, 0):  # nothing is left to do
        main(arguments)
        assert capsys.readouterr().err.count("--set channel_axis=-1") == count


@pytest.fixture
def described(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the images that are described, as they are."""
    names_of_images: list[str] = []
    read = describing.read_image
    monkeypatch.setattr(
        describing, "read_image", lambda path, size: (names_of_images.append(Path(path).name), read(path, size))[1]
    )
    return names_of_images


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names(folder)}


def test_what_is_done_is_kept(photos: Path, tmp_path: Path, described: list[str]) -> None:
    out = tmp_path / "out.parquet"
    command = ["hog", str(photos), "-o", str(out), "--quiet"]
    main(command)
    whole = contents(out)
    (out / "part-000001.parquet").unlink()
    (out / "part-000002.parquet").write_bytes(b"cut off")
    described.clear()
    main(command)
    assert sorted(described) == ["3.png", "4.png", "5.png", "6.png", "x.png"]
    assert contents(out) == whole
    damaged = bytearray(whole["part-000001.parquet"])
    damaged[1000] ^= 1
    (out / "part-000001.parquet").write_bytes(damaged)
    with pytest.raises(ValueError, match=r"part-000001\.parquet is damaged: rows 3 to 5"):
        list(DescriptorDataset(str(out)))
    described.clear()
    main(command)
    assert described == ["3.png", "4.png", "5.png"]
    assert contents(out) == whole


def test_a_new_photograph_is_the_only_one_to_be_described(
    photos: Path, tmp_path: Path, described: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Wherever it comes in the order of the folder; the shards of the others stay."""
    out = tmp_path / "out.parquet"
    command = ["hog", str(photos), "-o", str(out)]
    main(command)
    (photos / "7.png").write_bytes((photos / "0.png").read_bytes())
    before, times = contents(out), {name: (out / name).stat().st_mtime_ns for name in names(out)}
    described.clear()
    capsys.readouterr()
    main(command)
    assert described == ["7.png"]
    assert capsys.readouterr().out == f"8 of 9 images in {out}, 1 of them described now\n"
    assert names(out) == [*before, "part-000003.parquet"]
    for name in before:
        assert name == MANIFEST or (out / name).stat().st_mtime_ns == times[name]
    data = DescriptorDataset(str(out))
    assert [Path(row.path).name for row in data] == [*(f"{k}.png" for k in range(7)), "x.png", "7.png"]
    assert torch.equal(data[8].stored.descriptor, data[0].stored.descriptor)


def test_a_photograph_that_was_broken_is_described_when_it_is_repaired(
    photos: Path, tmp_path: Path, described: list[str]
) -> None:
    """With the others of its shard; so is one that was missing, and one of a shard that a kill left out."""
    out, lines = tmp_path / "out.parquet", tmp_path / "list.txt"
    lines.write_text(f"{photos}\n{photos / 'later.jpg'}\n")
    command = ["hog", f"@{lines}", "-o", str(out), "--quiet"]
    assert main(command) == 3
    (out / "part-000000.parquet").unlink()
    (photos / "x.png").write_bytes((photos / "0.png").read_bytes())
    (photos / "later.jpg").write_bytes((photos / "1.png").read_bytes())
    (photos / "0.png").write_bytes((photos / "1.png").read_bytes())
    lines.write_text(
        "\n".join(map(str, [*(photos / f"{k}.png" for k in range(7)), photos / "x.png", photos / "later.jpg"]))
    )
    described.clear()
    assert main(command) == 0
    assert sorted(described) == ["0.png", "1.png", "2.png", "6.png", "later.jpg", "x.png"]
    assert all(row.stored is not None for row in DescriptorDataset(str(out)))


def test_lists_patterns_and_urls(photos: Path, tmp_path: Path) -> None:
    lines = ["# some of them", f'"{photos / "2.png"}"', "", str(photos / "[5].png")]
    (tmp_path / "list.txt").write_text("\n".join(lines), encoding="utf-16")
    inputs = [str(photos / "[01].png"), (photos / "3.png").as_uri(), f"@{tmp_path / 'list.txt'}"]
    assert main(["hog", *inputs, "-o", str(tmp_path / "o.parquet"), "--quiet"]) == 0
    assert [Path(row.path).name for row in DescriptorDataset(str(tmp_path / "o.parquet"))] == [
        f"{k}.png" for k in (0, 1, 3, 2, 5)
    ]


@pytest.mark.parametrize(
    ("files", "url", "found"),
    [
        (["a b.png"], "file://{}/a%20b.png", ["a b.png"]),
        (["a[1].png"], "file://localhost{}/a%5B1%5D.png", ["a[1].png"]),
        (["a b.png", "a%20b.png"], "file://{}/a%20b.png", ["a%20b.png"]),
        (["a b1.png", "a b2.png"], "file://{}/a%20b*.png", ["a b1.png", "a b2.png"]),
        (["a b1.png", "a%20b2.png"], "file://{}/a%20b*.png", ["a%20b2.png"]),
        ([], "file://{}/a%20b.png", ["a%20b.png"]),
    ],
)
def test_a_url_with_escapes(tmp_path: Path, files: list[str], url: str, found: list[str]) -> None:
    """Its path is decoded if only then there is a file."""
    for name in files:
        (tmp_path / name).touch()
    images, _ = list_images(Namespace(inputs=[url.format(tmp_path)], output="x.parquet", command="hog"))
    assert [image.path.rpartition("/")[2] for image in images] == found


@pytest.mark.parametrize("readable", [True, False])
def test_the_state_of_a_file_that_may_not_be_read_is_unknown(
    photos: Path, monkeypatch: pytest.MonkeyPatch, readable: bool
) -> None:
    """So that its image is described when it may be."""
    monkeypatch.setattr("os.access", lambda path, mode: readable)
    [image], _ = list_images(Namespace(inputs=[str(photos / "0.png")], output="x.parquet", command="hog"))
    assert [image.bytes is None, image.version is None] == [not readable] * 2


def test_what_stands_for_no_image_is_skipped(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a list as on the command line; a file that is missing has a row."""
    (tmp_path / "list.txt").write_text(f"{photos / '*.jpg'}\n{photos / '0.png'}\n{photos / 'gone.png'}\n")
    out = str(tmp_path / "o.parquet")
    assert main(["hog", f"@{tmp_path / 'list.txt'}", str(photos / "*.tif"), "-o", out]) == 3
    told = capsys.readouterr().err
    assert all(f"skipped: {photos / name}" in told for name in ("*.jpg", "*.tif"))
    assert [row.error is None for row in DescriptorDataset(out)] == [True, False]


def test_an_interrupted_command_says_that_it_continues(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(job: describing.ShardJob) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(describing.ShardJob, "run", interrupt)
    assert main(["hog", str(photos), "-o", str(tmp_path / "o.parquet")]) == 130
    assert "continues" in capsys.readouterr().err


def test_shards_that_cannot_be_written_are_written_by_the_same_command(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["hog", str(photos), "-o", str(tmp_path / "o.parquet")]
    with monkeypatch.context() as patch:
        patch.setattr(describing.ShardJob, "run", Mock(side_effect=ValueError("the disk is full")))
        assert main(command) == 1
    assert "3 shards could not be written; the first: the disk is full" in capsys.readouterr().err
    assert main(command) == 3
    assert len(DescriptorDataset(str(tmp_path / "o.parquet"))) == 8


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "list.txt: expected a list of images, one per line: no such file"),
        (b"a\x80.png", "list.txt: expected a list of images, one per line: "),
        (b"# none\n", "there are no images among the inputs"),
    ],
)
def test_lists_without_images(
    tmp_path: Path, refused: Callable[..., None], content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / "list.txt").write_bytes(content)
    refused("hog", f"@{tmp_path / 'list.txt'}", "-o", str(tmp_path / "o.parquet"), message=message)


def test_archives_and_brackets(photos: Path, tmp_path: Path, refused: Callable[..., None]) -> None:
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
    with zipfile.ZipFile(tmp_path / "photos.zip", "w") as archive:
        for k, member in enumerate(("in/9.png", "in/10.png", "b[1].png")):
            archive.write(photos / f"{2 * (k // 2)}.png", member)
    refused(
        "hog",
        name,
        bracket,
        "-o",
        out,
        message=f"changed (zip://in/10.png::{tmp_path / 'photos.zip'}: 2,420 bytes, now 2,028)",
    )


def test_links_of_a_chain(photos: Path, tmp_path: Path) -> None:
    """The path is put where it was, though its letters stand elsewhere in the URL, too."""
    with zipfile.ZipFile(tmp_path / "p.zip", "w") as archive:
        archive.write(photos / "0.png", "p/0.png")
    cached = f"filecache::{photos.as_uri()}/[01].png"
    out = str(tmp_path / "o.parquet")
    assert main(["hog", f"zip://p::{tmp_path / 'p.zip'}", cached, "-o", out, "--quiet"]) == 0
    assert [Path(row.path.partition(".png")[0]).name for row in DescriptorDataset(out)] == ["0", "0", "1"]


def test_what_it_refuses(
    photos: Path, tmp_path: Path, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other, bad, out = (
        str(tmp_path / name) for name in ("photos/0.png", "photos/1.png", "photos/x.png", "o.parquet")
    )
    assert main(["hog", *[one] * 4, "-o", out, "--quiet"]) == 0
    refused("hog", *[other] * 4, "-o", out, message=f"4 images not among the inputs ({one}, {one}, {one}, …)")
    refused("hog", one, "-o", out, message=f"3 images not among the inputs ({one}, {one}, {one})")
    refused("hog", *[one] * 4, "-o", out, "--preset", "dpm", message="their preset is 'uoctti', not 'dpm'")
    refused("hog", *[one] * 4, "-o", out, "--set", "cell_size=4", message="their cell_size is (8, 8), not (4, 4)")
    refused("hog", *[one] * 4, "-o", out, "--size", "9", message="of images at full size, not at 9 pixels")
    with monkeypatch.context() as patch:
        patch.setattr(cache, "_key_of_package", lambda parts: "with a file edited")
        refused("hog", *[one] * 4, "-o", out, message="wrote it, and this is nablahog ")
    (tmp_path / "o.parquet" / MANIFEST).unlink()
    refused("hog", *[other] * 4, "-o", out, message="holds 2 shards of another data set")
    assert main(["hog", *[one] * 4, "-o", out, "--quiet"]) == 0  # the same as before, so that they are its own
    assert len(DescriptorDataset(out)) == 4
    refused("hog", f"zip://*.png::{bad}", "-o", str(tmp_path / "q.parquet"), message="File is not a zip file")
    refused("hog", bad, "-o", str(tmp_path / "q.parquet"), message="no image of 1 has a descriptor")
    (tmp_path / "s.parquet").write_bytes(b"x")
    refused("hog", one, "-o", str(tmp_path / "s.parquet"), message="expected a folder for the data set")
    refused("hog", one, "-o", "nostore://x.parquet", message="nostore://x.parquet: Protocol not known")
    refused(
        "hog", one, "-o", str(tmp_path / "a.npz"), "--workers", "2", message="--workers goes with a data set", status=2
    )


FILES = ("a10.png", "a2.jpg", "a1.png", ".b.png", "notes.txt", "more/b.jpg", "more/deep/c.jpg", ".hidden/d.jpg")


@pytest.fixture
def folder(tmp_path: Path) -> str:
    """A folder of files, also in memory and in an archive."""
    memory, folder = fsspec.filesystem("memory"), tmp_path / "photos"
    with zipfile.ZipFile(tmp_path / "photos.zip", "w") as archive:
        for file in FILES:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_bytes(b"")
            memory.pipe(f"/{tmp_path.name}/{file}", b"")
            archive.writestr(f"photos/{file}", b"")
    return str(folder)


@pytest.mark.parametrize("pattern", ["", "/*.jpg", "/**/*.jpg", "/more", "/.hidden/*"])
def test_stores_have_the_images_of_a_folder(folder: str, pattern: str, capsys: pytest.CaptureFixture[str]) -> None:
    above = Path(folder).parent
    beginnings = {
        folder: f"{folder}/",
        f"file://{folder}": f"file://{folder}/",
        f"memory://{above.name}": f"memory:///{above.name}/",
        "zip://photos": "zip://photos/",
    }
    found, told = [], []
    for name, beginning in beginnings.items():
        end = f"::{above / 'photos.zip'}" if name.startswith("zip") else ""
        images, _ = list_images(Namespace(inputs=[f"{name}{pattern}{end}"], output="x.parquet", command="hog"))
        found.append([image.path.removeprefix(beginning).removesuffix(end) for image in images])
        told.append(capsys.readouterr().err)
    assert found == [found[0]] * 4
    if pattern == "":
        assert found[0] == ["a1.png", "a2.jpg", "a10.png"]
        for line in told:
            assert "1 subfolder left out, such as more" in line
            (advised,) = shlex.split(line.partition("a pattern takes them, ")[2])
            images, _ = list_images(Namespace(inputs=[advised], output="x.parquet", command="hog"))
            assert [Path(image.path.partition("::")[0]).name for image in images] == ["a2.jpg", "b.jpg", "c.jpg"]


def test_patterns_of_urls_in_a_list_are_expanded(folder: str, tmp_path: Path) -> None:
    """But not the question marks of signed URLs."""
    above = Path(folder).parent.name
    (tmp_path / "list.txt").write_text(f"memory://{above}/*.png\nmemory://{above}/a2.jpg?signed=a1\n")
    images, _ = list_images(Namespace(inputs=[f"@{tmp_path / 'list.txt'}"], output="x.parquet", command="hog"))
    assert [image.path.rpartition("/")[2] for image in images] == ["a1.png", "a10.png", "a2.jpg?signed=a1"]
