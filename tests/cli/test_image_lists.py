"""The images that a folder, a pattern or a URL stands for: in a store the same as on the disk."""

from __future__ import annotations

import shlex
import zipfile
from argparse import Namespace
from pathlib import Path

import fsspec
import pytest

from nablahog.cli.image_lists import list_images

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
