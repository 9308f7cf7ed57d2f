"""Learning from photographs on disk, as ``nablahog learn`` does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .evaluate.photographs import Photographs, read_folder, shipped
from .hog import HOGSpec
from .invert import LearnedPrior, train_prior
from .output import remove_parts


def lessons(folder: Path | None, least: tuple[int, int], size: int) -> Photographs:
    """The photographs to learn from.

    Args:
        folder: of images; None for those that come with scikit-image.
        least: (height, width) in pixels of the smallest image that is of use.
        size: images are shrunk to at most so many pixels on the longer side; 0 leaves them as they are.

    Returns:
        At least one image; files that cannot be read, and images that are too small, have failed.

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such folder.
        ValueError: it holds no image, or none to learn from.
    """
    read = shipped(size=size, whole=True) if folder is None else read_folder(folder, size=size)
    for name, image in list(read.images.items()):
        height, width = image.shape
        if height < least[0] or width < least[1]:
            read.failed[name] = f"expected at least {least[0]}x{least[1]} pixels, got {height}x{width}"
            del read.images[name]
    if not read.images:
        name, reason = next(iter(read.failed.items()))
        raise ValueError(f"{folder or 'scikit-image'}: no image is usable; the first: {name}: {reason}")
    return read


def learn_prior(
    output: Path,
    photographs: Photographs,
    spec: HOGSpec,
    *,
    epochs: int | None,
    seed: int,
    progress: Callable[[int, int, str], None],
) -> LearnedPrior:
    """Learns a prior and writes it to ``output``.

    After each epoch what is learned is kept beside it, in ``output.checkpoint``, from where a run that was interrupted
    goes on.  It is removed when ``output`` is whole.

    Args:
        output: the file.
        photographs: to learn from.
        spec: the dialect.
        epochs, seed, progress: as for :func:`nablahog.train_prior`.

    Raises:
        ValueError, OSError: as :func:`nablahog.train_prior`, or ``output`` cannot be written.
    """
    remove_parts(output.parent, older_than=60)
    checkpoint = output.with_name(f"{output.name}.checkpoint")
    prior = train_prior(photographs.images, spec, epochs=epochs, seed=seed, checkpoint=checkpoint, progress=progress)
    prior.save(output)
    checkpoint.unlink(missing_ok=True)
    return prior
