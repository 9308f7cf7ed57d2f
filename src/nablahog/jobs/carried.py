"""Files that jobs read, on machines that may not have them: they travel to a worker once, and are found there."""

from __future__ import annotations

from pathlib import Path

_PLACES: dict[str, Path] = {}


def found(path: Path) -> Path:
    """Where a file of the machine that asks for work is on this one."""
    return _PLACES.get(str(path), path)


def put(files: dict[str, bytes], folder: Path) -> None:
    """Writes files into a folder of this machine; :func:`found` then finds them by their paths on the other."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, (path, data) in enumerate(files.items()):
        place = folder / f"{number}{Path(path).suffix}"
        place.write_bytes(data)
        _PLACES[path] = place
