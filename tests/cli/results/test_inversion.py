"""Batches of inversions."""

from __future__ import annotations

import pytest
import torch

import nablahog
from nablahog import presets
from nablahog.cli.results import inversion


def test_batches_hold_one_spec_and_size_and_not_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    def source(rows: int, spec: nablahog.HOGSpec) -> inversion.Source:
        size = (8 * rows, 8)
        return inversion.Source("p", "p", torch.zeros(rows, 1, spec.channels), spec, size, None)

    one, other = presets.paper(), presets.uoctti()
    sources = [source(1, one), source(2, one), source(1, other), source(1, one), source(1, one)]
    assert inversion.batches(sources) == [[0, 3, 4], [1], [2]]
    monkeypatch.setattr(inversion, "BATCH_PIXELS", 130)
    assert inversion.batches(sources) == [[0, 3], [4], [1], [2]]
