"""One damaged file, and what has to be said of it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from nablahog import load_descriptor, presets, save_descriptor

from .harness import check_sentence


def test_half_a_file_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "d.npz"
    save_descriptor(path, torch.zeros(2, 3, 31), presets.uoctti(8), image_size=(16, 24))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ValueError, match=r"d\.npz") as refusal:
        load_descriptor(path)
    check_sentence(str(refusal.value))
