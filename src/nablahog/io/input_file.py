"""A file to read: one on the disk, or bytes under a name."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeAlias


@dataclass(frozen=True)
class InputFile:
    """A file on the disk, or bytes under a name, such as an upload or what came from standard input.

    All readers of files take one in place of a path.

    Attributes:
        name: its path; of bytes any name, whose ending tells the format and by which errors call it.
        content: the bytes; None for a file on the disk.

    >>> import io
    >>> from PIL import Image
    >>> from nablahog.io.images import read_image
    >>> from nablahog.io.input_file import InputFile
    >>> png = io.BytesIO()
    >>> Image.new("RGB", (4, 2)).save(png, "PNG")
    >>> read_image(InputFile("upload.png", png.getvalue())).shape
    torch.Size([3, 2, 4])
    """

    name: str
    content: bytes | None = None

    def __str__(self) -> str:
        """The name."""
        return self.name

    @property
    def ending(self) -> str:
        """The ending of its name in lower case, as ".png"; empty if there is none."""
        return Path(self.name).suffix.lower()

    @property
    def size(self) -> int:
        """The number of its bytes."""
        return os.path.getsize(self.name) if self.content is None else len(self.content)

    def check(self, expected: str) -> None:
        """Raises FileNotFoundError or ValueError unless it is a regular file or bytes.

        ``expected`` says what it should be, such as "an image file".
        """
        if self.content is not None:
            return
        path = Path(self.name)
        if not path.exists():
            raise FileNotFoundError(f"{path}: no such file")
        if not path.is_file():
            raise ValueError(f"{path}: expected {expected}, got a {'folder' if path.is_dir() else 'special file'}")

    def open(self) -> BinaryIO:
        """A stream of its bytes, to be closed."""
        return open(self.name, "rb") if self.content is None else io.BytesIO(self.content)

    def read(self, most: int = -1) -> bytes:
        """Its bytes; at most so many, if ``most`` is not negative."""
        with self.open() as stream:
            return stream.read(most)

    def starts_as(self, ending: str, start: bytes) -> bool:
        """Whether its name has this ending, or its first bytes are these."""
        if self.ending == ending:
            return True
        if self.content is None and not os.path.isfile(self.name):  # a pipe would wait for its first bytes
            return False
        try:
            return self.read(len(start)) == start
        except OSError:
            return False


Readable: TypeAlias = str | os.PathLike[str] | InputFile
"""What readers of files take: a path, or bytes under a name."""


def input_file(file: Readable) -> InputFile:
    """The file of a path, or ``file`` itself.  Raises TypeError for anything else."""
    if isinstance(file, InputFile):
        return file
    if not isinstance(file, str | bytes | os.PathLike):
        write = "write nablahog.io.input_file.InputFile('a.npz', stream.read()) of a stream, with its file's name"
        raise TypeError(f"a file to read must be a path, got {type(file).__name__}: {write}")
    return InputFile(os.fsdecode(file))
