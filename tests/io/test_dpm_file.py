"""Reading models of voc-release5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.io import savemat
from scipy.ndimage import zoom

from nablahog.io import dpm_file
from nablahog.io.dpm_file import is_dpm_file, load_dpm
from tests.io.dpm_models import PART, ROOT, structs, weights, written


def test_root_and_parts(tmp_path: Path) -> None:
    path = written(tmp_path / "toy.mat")
    result = load_dpm(path)
    assert is_dpm_file(path)
    assert (result.class_name, result.cell_size) == ("toy", 8)
    assert [each.name for each in result.filters] == ["component 1, root", "component 1, parts"]
    root, parts = (each.weights for each in result.filters)
    assert root.dtype == torch.float32
    np.testing.assert_allclose(root, weights(ROOT, 0), atol=1e-6)
    together, covered = np.zeros((6, 8, 32)), np.zeros((6, 8), bool)
    for rows, cols, number in ((slice(2, 4), slice(1, 3), 1), (slice(3, 5), slice(2, 4), 2)):
        together[rows, cols] += weights(PART, number)
        covered[rows, cols] = True
    together[3, 2] /= 2  # where they overlap
    np.testing.assert_allclose(parts[covered], together[covered], atol=1e-6)
    background = zoom(weights(ROOT, 0), (2, 2, 1), order=1, mode="nearest", grid_mode=True)
    scale = np.linalg.norm(together) / np.linalg.norm(background[covered])
    np.testing.assert_allclose(parts[~covered], scale * background[~covered], atol=1e-5)


def test_refusals(tmp_path: Path) -> None:
    (tmp_path / "text.mat").write_text("hello")
    savemat(tmp_path / "other.mat", {"w": np.ones(3)})
    with pytest.raises(ValueError, match=r"other.mat: expected a model of voc-release5"):
        load_dpm(tmp_path / "other.mat")
    assert not is_dpm_file(tmp_path / "other.mat")
    assert not is_dpm_file(tmp_path / "text.mat")
    assert not is_dpm_file(tmp_path / "none.mat")


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no filters": ({"filters": None}, "expected a model of voc-release5, but it has no 'filters'"),
    "31 channels": (
        {"blocks": structs([{"w": np.ones(31), "shape": np.array([1, 1, 31])} for _ in range(3)])},
        r"a filter has the shape \(1, 1, 31\), not \(rows, cols, 32\)",
    ),
    "NaN": (
        {"blocks": structs([{"w": np.full(32, np.nan), "shape": np.array([1, 1, 32])} for _ in range(3)])},
        "a filter holds NaN or Inf",
    ),
    "parts outside": (
        {"blocks": structs([{"w": np.ones(32), "shape": np.array([1, 1, 32])} for _ in range(3)])},
        "a part of 1x1 cells at 2, 1 is outside its root",
    ),
    "a start that is not there": ({"start": 99}, "expected a model of voc-release5"),
    "a cell of infinite size": ({"sbin": np.inf}, "numbers that are not integers within ±1,000,000"),
}


def test_a_filter_that_is_used_too_often(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dpm_file, "MAX_WEIGHTS", 4352)  # of both components, 5 · 3 · 4 · 32 of the root
    load_dpm(written(tmp_path / "toy.mat"))
    monkeypatch.setattr(dpm_file, "MAX_WEIGHTS", 4351)
    with pytest.raises(ValueError, match="its components have more than 4,351 weights"):
        load_dpm(tmp_path / "toy.mat")


@pytest.mark.parametrize("name", WRONG)
def test_wrong_models(tmp_path: Path, name: str) -> None:
    changes, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        load_dpm(written(tmp_path / "wrong.mat", **changes))
