"""The photographs that ``nablahog learn`` learns from."""

from __future__ import annotations

from pathlib import Path

from ...evaluate.photographs import Photographs, read_folder, sample_photographs


def training_photographs(folder: Path | None, least: tuple[int, int], size: int) -> Photographs:
    """The photographs to learn from.

    Args:
        folder: of images; None for the sample photographs.
        least: (height, width) in pixels of the smallest image that can be learned from.
        size: images are shrunk to at most so many pixels on the longer side; 0 leaves them as they are.

    Returns:
        At least one image; ``failed`` has the files that cannot be read and the images that are too small.

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such folder.
        ValueError: it holds no image, or none to learn from.
    """
    read = sample_photographs(size=size, whole=True) if folder is None else read_folder(folder, size=size)
    for name, image in list(read.images.items()):
        height, width = image.shape
        if height < least[0] or width < least[1]:
            read.failed[name] = f"expected at least {least[0]}x{least[1]} pixels, got {height}x{width}"
            del read.images[name]
    if not read.images:
        name, reason = next(iter(read.failed.items()))
        raise ValueError(f"{folder or 'scikit-image'}: no image is usable; the first: {name}: {reason}")
    return read
