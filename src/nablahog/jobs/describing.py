"""A shard of a data set of descriptors, as a job: images are read and the shard is written where the work is done."""

from __future__ import annotations

import time
from dataclasses import dataclass

import fsspec
import numpy as np
from torch import Tensor

from ..hog import HOGSpec
from ..hog.descriptor import describe
from ..io.descriptor_dataset import Row, write_shard
from ..io.descriptor_file import StoredDescriptor
from ..io.images import read_image
from ..io.input_file import InputFile
from .store import JobResult


@dataclass(frozen=True)
class ShardJob:
    """Descriptors of images (files or URLs), shrunk to ``size`` pixels (0: never), for the shard ``target``.

    Its ``key`` is :func:`.descriptor_dataset.shard_key`.
    """

    paths: tuple[str, ...]
    spec: HOGSpec
    size: int
    target: str
    key: str

    def run(self) -> JobResult:
        """Writes the shard, where an image without a descriptor has a row, too; figures are ``images`` and ``failed``.

        Raises:
            OSError: the shard cannot be written.
        """
        began = time.perf_counter()
        rows = [self._row(path) for path in self.paths]
        write_shard(self.target, rows, self.spec, self.key)
        failed = sum(row.stored is None for row in rows)
        figures = {"images": len(rows), "failed": failed}
        return JobResult([figures], np.zeros((1, 0), np.uint8), time.perf_counter() - began)

    def _row(self, path: str) -> Row:
        try:
            image = _read(path, self.size)
            descriptor = describe(image[None], self.spec)[0].float()
            return Row(path, StoredDescriptor(descriptor, self.spec, (image.shape[1], image.shape[2])))
        except (ValueError, OSError) as error:
            return Row(path, None, " ".join(str(error).removeprefix(f"{path}: ").split()))


def _read(path: str, size: int) -> Tensor:
    if "://" not in path:
        return read_image(path, size)
    with fsspec.open(path, "rb") as remote:
        return read_image(InputFile(path, remote.read()), size)
