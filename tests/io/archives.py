"""Archives that do not hold what was saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from nablahog.io.learned_model import LearnedModel


def arrays_of(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def rewrite(path: Path, **changed: Any) -> None:
    """Changes arrays of an archive; those that are None are gone."""
    arrays = {**arrays_of(path), **changed}
    with open(path, "wb") as file:
        np.savez(file, **{name: value for name, value in arrays.items() if value is not None})


def check_refused(model: LearnedModel, path: Path, changed: dict[str, Any], message: str) -> None:
    """Checks that its file is refused, in one sentence that begins with the path, if arrays are changed."""
    model.save(path)
    rewrite(path, **changed)
    with pytest.raises(ValueError, match=message) as caught:
        type(model).load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
