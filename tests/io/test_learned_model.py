"""Files of learned models: what is saved is loaded, and what is damaged or of another kind is refused."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
import torch

from nablahog.io.learned_model import account, check_tensor

from .archives import arrays_of, check_refused
from .tiny_models import models

KINDS = list(models())
every_kind = pytest.mark.parametrize("kind", KINDS)


@every_kind
def test_round_trip(tmp_path: Path, kind: str) -> None:
    model = models()[kind]
    model.save(tmp_path / "x")
    assert os.listdir(tmp_path) == ["x"]
    stored = type(model).load(tmp_path / "x")
    _check_same(vars(stored), vars(model))
    stored.save(tmp_path / "y")
    assert (tmp_path / "x").read_bytes() == (tmp_path / "y").read_bytes()
    assert set(arrays_of(tmp_path / "x")) == {"format", *model.ARRAYS}
    with ZipFile(tmp_path / "x") as archive:
        compressed = {part.compress_type == ZIP_DEFLATED for part in archive.infolist()}
    assert compressed == {kind in ("prior", "background")}


def _check_same(values: dict[str, Any], expected: dict[str, Any]) -> None:
    assert set(values) == set(expected)
    for name, value in values.items():
        if isinstance(value, torch.Tensor):
            assert torch.equal(value, expected[name])
        elif isinstance(value, tuple) and isinstance(value[0], torch.Tensor):
            assert all(torch.equal(a, b) for a, b in zip(value, expected[name], strict=True))
        else:
            assert value == expected[name]


@pytest.mark.parametrize(
    ("kind", "changed", "message"),
    [
        ("bovw", {"image_size": np.array([16])}, r"image_size must hold 2 integers, got int64 of shape \(1,\)"),
        ("bovw", {"image_size": np.array([16.0, 20.0])}, "image_size must hold 2 integers, got float64"),
        ("prior", {"widths": np.array(8)}, r"widths must be a list of integers, got int64 of shape \(\)"),
        ("bovw", {"cell": np.array([4])}, r"cell must be one integer, got int64 of shape \(1,\)"),
        ("bovw", {"cell": np.array(4.0)}, "cell must be one integer, got float64"),
        ("hoggles", {"sparsity": np.array(1)}, "sparsity must be one float64, got int64"),
        ("hoggles", {"spec": np.array(1)}, "spec must be one string, got int64"),
        ("hoggles", {"spec": np.array(["{}"])}, r"spec must be one string, got <U2 of shape \(1,\)"),
    ],
)
def test_arrays_of_other_kinds(tmp_path: Path, kind: str, changed: dict[str, Any], message: str) -> None:
    check_refused(models()[kind], tmp_path / "x", changed, message)


def test_bounds_of_tensors() -> None:
    for value, bounds, message in (
        (torch.tensor([0, torch.nan]), (-2, 2), "^the x must lie within ±2, got NaN, Inf or more$"),
        (torch.tensor([0, 2.1]), (-2, 2), "^the x must lie within ±2, got NaN, Inf or more$"),
        (torch.tensor([0, -0.1]), (0, 32766), "^the x must lie in 0…32766, got NaN, Inf or other values$"),
        (torch.zeros(3), (0, 1), r"^the x must be float32 of shape \(2,\), got float32 of \(3,\)$"),
        (torch.zeros(2).double(), (0, 1), r"^the x must be float32 of shape \(2,\), got float64 of \(2,\)$"),
    ):
        with pytest.raises(ValueError, match=message):
            check_tensor("x", value, torch.float32, (2,), *bounds)


@dataclass(frozen=True)
class Account:
    names: tuple[str, ...]
    losses: tuple[float, ...]
    count: int
    rate: float
    by: str


ACCOUNT = Account(("a", "ü"), (0.1 + 0.2, 1.0), 3, 1e-300, "x\n")
CODEC, WRITTEN = account(Account), json.dumps(asdict(ACCOUNT))


def test_accounts() -> None:
    result = CODEC.decode({"x": np.array(CODEC.encode(ACCOUNT))}, "x")
    assert result == ACCOUNT
    assert isinstance(result.losses[1], float)


@pytest.mark.parametrize("stored", ["", "null", WRITTEN.replace('"count": 3', '"count": "x"'), WRITTEN[:-1]])
def test_what_is_no_account(stored: str) -> None:
    assert stored != WRITTEN
    with pytest.raises(ValueError, match=r"^how it was learned cannot be read: "):
        CODEC.decode({"x": np.array(stored)}, "x")
