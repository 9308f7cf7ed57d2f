"""A shard of a data set of descriptors, as a job: images are read and the shard is written where the work is done."""

from __future__ import annotations

from dataclasses import dataclass

import fsspec
from torch import Tensor

from ..hog import HOGSpec
from ..hog.descriptor import describe
from ..io.descriptor_dataset import Row, write_shard
from ..io.descriptor_file import StoredDescriptor
from ..io.images import read_image
from ..io.input_file import InputFile
from ..runtime.errors import explain


@dataclass(frozen=True)
class ShardJob:
    """Descriptors of images (files or URLs), shrunk to ``size`` pixels (0: never), for the shard ``target``.

    Its ``key`` is :meth:`.dataset_manifest.Manifest.key`.
    """

    paths: tuple[str, ...]
    spec: HOGSpec
    size: int
    target: str
    key: str

    def run(self) -> int:
        """Writes the shard, where an image without a descriptor has a row, too; returns the number of its rows.

        Raises:
            OSError: the shard cannot be written.
        """
        write_shard(self.target, map(self._row, self.paths), self.spec, self.key)
        return len(self.paths)

    def _row(self, path: str) -> Row:
        try:
            image = _read(path, self.size)
            descriptor = describe(image[None], self.spec)[0].float()
            return Row(path, StoredDescriptor(descriptor, self.spec, (image.shape[1], image.shape[2])))
        except (ValueError, OSError) as error:
            return Row(path, None, " ".join(explain(error).removeprefix(f"{path}: ").split()))


def _read(path: str, size: int) -> Tensor:
    if "://" not in path:
        return read_image(path, size)
    with fsspec.open(path, "rb") as remote:
        return read_image(InputFile(path, remote.read()), size)
