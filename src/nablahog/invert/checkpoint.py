"""The state of a long learning on disk, from which a killed run is resumed with the same result."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from numpy import generic
from numpy.typing import NDArray

from ..io.files import check_file
from ..io.npz import read_arrays, text, write_arrays

FORMAT = 1
_log = logging.getLogger(__name__)
State = TypeVar("State")


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

    def restore(self, read: Callable[[dict[str, NDArray[generic]]], State]) -> State | None:
        """What ``read`` makes of the arrays; None if there is no file, or a damaged one.

        A damaged file is renamed, which the log tells: the learning starts afresh.

        Args:
            read: raises ValueError if the arrays are impossible.

        Raises:
            ValueError: the file is of another learning or another version, or no regular file.
            OSError: it cannot be read or renamed.
        """
        if self.path is None or not self.path.exists():
            return None
        check_file(self.path, f"a checkpoint of a {self.kind}")
        with open(self.path, "rb"):
            pass  # what may not be read is not damaged
        try:
            arrays = read_arrays(self.path, f"checkpoint of a {self.kind}", ("format", "identity", *self.names))
            other = self._other(arrays)
            state = None if other else read(arrays)
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError):
            self._set_aside(self.path)
            return None
        if other:
            raise ValueError(f"{self.path}: {other}")
        return state

    def _other(self, arrays: dict[str, NDArray[generic]]) -> str | None:
        """What else the file is; None if it is of this learning.

        Raises:
            KeyError, RecursionError, TypeError, ValueError: it is damaged.
        """
        version = int(arrays["format"].item())
        if version != FORMAT:
            return f"this version reads checkpoints of format {FORMAT}, got {version}"
        identity = json.loads(text(arrays, "identity"))
        differing = [key for key, value in self.identity.items() if identity[key] != value]
        if not differing:
            return None
        return (
            f"the checkpoint of another {self.kind} (of other {', '.join(differing)}); "
            "finish that one, or remove the file"
        )

    def _set_aside(self, path: Path) -> None:
        aside = path.with_name(f"{path.name}.damaged")
        os.replace(path, aside)
        _log.warning("%s is damaged: it is now called %s, and the %s starts afresh", path, aside.name, self.kind)
