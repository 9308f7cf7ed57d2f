"""Weights of detectors in files: of which window they are, and that a bias after them is ignored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import nablahog
from nablahog import presets
from nablahog.compat.opencv import HOGDescriptor
from nablahog.requests.inversion import GlyphRequest
from nablahog.requests.templates import read_templates


@pytest.mark.parametrize(("length", "size"), [(3780, (128, 64)), (1980, (96, 48))])
def test_the_windows_of_opencvs_people_detectors(tmp_path: Path, length: int, size: tuple[int, int]) -> None:
    weights = np.random.default_rng(0).standard_normal(length + 1).astype(np.float32)
    for name, vector in (("plain", weights[:-1]), ("biased", weights), ("row", weights[np.newaxis])):
        np.save(tmp_path / f"{name}.npy", vector)
        [template] = read_templates(str(tmp_path / f"{name}.npy"), GlyphRequest())
        assert (template.spec.name, template.image_size) == ("opencv", size)
        native = nablahog.to_layout(template.descriptor[None], presets.opencv(size[::-1]))
        assert torch.equal(native.flatten(), torch.from_numpy(weights[:-1]))
    np.save(tmp_path / "longer.npy", np.append(weights, 0))
    with pytest.raises(ValueError, match="preset"):
        read_templates(str(tmp_path / "longer.npy"), GlyphRequest())


def test_a_descriptor_that_opencv_saved(tmp_path: Path) -> None:
    hog, path = HOGDescriptor(), str(tmp_path / "hog.yml")
    hog.save(path)
    with pytest.raises(ValueError, match=r"hog\.yml: expected a HOGDescriptor with the coefficients of its detector"):
        read_templates(path, GlyphRequest())
    weights = np.linspace(-1, 1, 3781, dtype=np.float32)
    hog.setSVMDetector(weights)
    hog.save(path)
    [template] = read_templates(path, GlyphRequest())
    assert (template.spec, template.image_size) == (presets.opencv(), (128, 64))
    native = nablahog.to_layout(template.descriptor[None], presets.opencv())
    torch.testing.assert_close(native.flatten(), torch.from_numpy(weights[:-1]))
