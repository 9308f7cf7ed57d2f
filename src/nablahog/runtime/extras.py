"""Packages that only a few uses need: the extras of ``pyproject.toml``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

PACKAGES = {
    "app": "scikit-image starlette uvicorn websockets msgspec",
    "cluster": "dask distributed",
    "dataset": "pyarrow fsspec",
    "completion": "argcomplete",
    "gpu": "triton",
    "heic": "pillow-heif",
    "skimage": "scikit-image",
    "sklearn": "scikit-learn",
}
"""The packages of each extra."""


class MissingExtra(ModuleNotFoundError, ValueError):
    """A package of an extra is not installed; the message says how to install it."""


INSTALL_COMMANDS = {name: f"pip install {packages}" for name, packages in PACKAGES.items()}
"""What installs each extra, also where this package is not published; the pages say the same."""


@contextmanager
def extra(name: str, use: str) -> Iterator[None]:
    """Turns a failed import in the block into a :class:`MissingExtra`, for a use such as "a cluster"."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("nablahog"):
            raise
        raise MissingExtra(f"{use} needs {error.name}: {INSTALL_COMMANDS[name]}", name=error.name) from None
