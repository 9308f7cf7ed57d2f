"""The state of a long learning on disk, from which a killed run is resumed with the same result."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from numpy import generic
from numpy.typing import NDArray

from ..io.npz import check_format, naming, read_arrays, text, write_arrays

FORMAT = 1


class Checkpoint:
    """The file of one learning.

    Args:
        path: its path; None for no file.
        kind: of learning, for messages.
        identity: what the result depends on, by name; values that are equal after a round trip through JSON.
        names: of the arrays that it holds.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        kind: str,
        identity: Mapping[str, object],
        names: Sequence[str],
    ) -> None:
        self.path = None if path is None else Path(path)
        self.kind, self.identity, self.names = kind, identity, names

    def save(self, arrays: Mapping[str, object]) -> None:
        """Writes ``arrays``, in place of those written before.

        Raises:
            OSError: the file cannot be written.
        """
        if self.path is not None:
            write_arrays(self.path, FORMAT, {"identity": json.dumps(self.identity), **arrays})

    def restore(self) -> dict[str, NDArray[generic]] | None:
        """The arrays; None if there is no file.

        Raises:
            ValueError: it is of another learning, damaged, or no such file.
        """
        if self.path is None or not self.path.exists():
            return None
        arrays = read_arrays(self.path, f"checkpoint of a {self.kind}", ("format", "identity", *self.names))
        with naming(self.path):
            check_format(arrays, "checkpoint", FORMAT)
            try:
                identity = json.loads(text(arrays, "identity"))
                differing = [key for key, value in self.identity.items() if identity[key] != value]
            except (KeyError, TypeError, ValueError, RecursionError) as error:
                raise ValueError(f"the checkpoint cannot be read: {error}") from None
            if differing:
                raise ValueError(
                    f"the checkpoint of another {self.kind} (of other {', '.join(differing)}); "
                    "finish that one, or remove the file"
                )
        return {name: arrays[name] for name in self.names}

    def damaged(self) -> ValueError:
        """The error to raise if the arrays are impossible."""
        return ValueError(f"{self.path}: the checkpoint is damaged")
