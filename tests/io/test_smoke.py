"""A descriptor in a file."""

from __future__ import annotations

from pathlib import Path

import torch

from nablahog import load_descriptor, presets, save_descriptor


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    descriptor = torch.arange(2 * 3 * 31.0).reshape(2, 3, 31)
    save_descriptor(tmp_path / "d.npz", descriptor, presets.uoctti(8), image_size=(17, 25))
    stored = load_descriptor(tmp_path / "d.npz")
    assert torch.equal(stored.descriptor, descriptor)
    assert (stored.spec, stored.image_size) == (presets.uoctti(8), (17, 25))
