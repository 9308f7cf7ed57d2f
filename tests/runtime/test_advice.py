"""Every warning of the package is of the line that called it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import nablahog
from nablahog import HOG, HOGLoss, hog

PACKAGE = Path(nablahog.__file__).parent
BRIGHT = torch.full((1, 1, 32, 32), 255.0)


def transform() -> None:
    pytest.importorskip("sklearn")
    from sklearn.pipeline import make_pipeline

    from nablahog.compat.sklearn import HOGTransformer

    make_pipeline(HOGTransformer()).fit_transform(np.full((1, 32, 32), 255.0))


CALLS = {
    "hog": lambda: hog(BRIGHT, "uoctti"),
    "a layer": lambda: HOG("uoctti")(BRIGHT),
    "a layer of a network": lambda: torch.nn.Sequential(torch.nn.Identity(), HOG("uoctti"))(BRIGHT),
    "without gradients": lambda: torch.no_grad()(HOG("uoctti"))(BRIGHT),
    "a loss": lambda: HOGLoss("uoctti")(BRIGHT, BRIGHT),
    "forward of a loss": lambda: HOGLoss("uoctti").forward(BRIGHT, BRIGHT),
    "a pipeline": transform,
}


@pytest.mark.parametrize("name", CALLS)
def test_the_line_that_called_is_warned_of(name: str) -> None:
    call: Callable[[], Any] = CALLS[name]
    with pytest.warns(UserWarning, match="far beyond 0…1") as caught:
        call()
    assert {warning.filename for warning in caught} == {__file__}


def test_all_warnings_are_of_the_caller() -> None:
    sources = {file for file in PACKAGE.rglob("*.py") if "warnings.warn(" in file.read_text(encoding="utf-8")}
    assert sources == {PACKAGE / "runtime" / "advice.py"}
