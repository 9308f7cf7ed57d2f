"""Files and folders of the client on the workers of a cluster, which may have no folder in common with it."""

from __future__ import annotations

from pathlib import Path

_COPIES: dict[str, Path] = {}
_FOLDERS: list[Path] = []  # at most one, on a worker of a cluster


def local_path(path: Path) -> Path:
    """The copy on this machine of a file of the client; the path itself where there is none."""
    return _COPIES.get(str(path), path)


def local_folder(path: Path) -> Path:
    """A folder where jobs keep what others need, too: the client's, where this machine has it, or one of the worker."""
    return path if path.is_dir() or not _FOLDERS else _FOLDERS[0] / path.name


def store_files(files: dict[str, bytes], folder: Path) -> None:
    """Writes copies into a folder of this worker, for :func:`local_path`.

    Args:
        files: contents by their paths on the client.
        folder: made if missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _FOLDERS[:] = [folder]
    for number, (path, data) in enumerate(files.items()):
        copy = folder / f"{number}{Path(path).suffix}"
        copy.write_bytes(data)
        _COPIES[path] = copy
