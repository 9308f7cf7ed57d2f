"""The state of a long training in a file, from which it is resumed with the same result."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from .files import replacing
from .input_file import input_file


@dataclass(frozen=True)
class Checkpoint:
    """A file with the state of a training, and what its result depends on.

    Attributes:
        path: the file; None if nothing is to be saved.
        identity: texts, numbers and lists of these by name: all that the result depends on.
    """

    path: str | os.PathLike[str] | None
    identity: Mapping[str, Any]

    def save(self, state: Mapping[str, Any]) -> None:
        """Replaces the file, whole or not at all, by tensors, texts, numbers, and lists and dicts of these."""
        if self.path is not None:
            with replacing(self.path) as file:
                torch.save({"identity": dict(self.identity), **state}, file)

    def resume(self, restore: Callable[[Mapping[str, Any]], object]) -> None:
        """Calls ``restore`` with the state that was saved last, if there is one.  Nothing in the file is ever run.

        Raises:
            ValueError: the file is damaged or of another training.
            OSError: it cannot be read.
        """
        if self.path is None or not os.path.exists(self.path):
            return
        path = Path(self.path)
        input_file(path).check("a checkpoint of a training")
        try:
            state = torch.load(path, map_location="cpu", weights_only=True)
            saved = dict(state["identity"])
            differing = [name for name, value in self.identity.items() if name not in saved or saved[name] != value]
            if not differing:
                restore(state)
        except (EOFError, LookupError, RuntimeError, TypeError, ValueError, pickle.UnpicklingError) as error:
            raise ValueError(
                f"{path} is no checkpoint of a training, or is damaged: remove it to start afresh"
            ) from error
        if differing:
            raise ValueError(
                f"{path} is the checkpoint of another training (with other {', '.join(differing)}); finish that one, "
                "or remove the file"
            )
