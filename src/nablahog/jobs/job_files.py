"""Files that jobs read: a copy for each worker of a cluster, which may have no folder in common with the client."""

from __future__ import annotations

from pathlib import Path

_COPIES: dict[str, Path] = {}


def local_path(path: Path) -> Path:
    """The copy on this machine of a file of the client; the path itself where there is none."""
    return _COPIES.get(str(path), path)


def store_files(files: dict[str, bytes], folder: Path) -> None:
    """Writes copies into a folder of this machine, for :func:`local_path`.

    Args:
        files: contents by their paths on the client.
        folder: made if missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number, (path, data) in enumerate(files.items()):
        copy = folder / f"{number}{Path(path).suffix}"
        copy.write_bytes(data)
        _COPIES[path] = copy
