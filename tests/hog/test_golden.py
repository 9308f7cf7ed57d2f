"""The operator against stored outputs of the original program, see ``tests/golden/README.md``."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets

with np.load(Path(__file__).parents[1] / "golden" / "vlfeat_uoctti.npz", allow_pickle=False) as archive:
    VLFEAT = {name: archive[name] for name in archive.files}
CASES: list[dict[str, Any]] = json.loads(str(VLFEAT["cases"]))


def load(number: int) -> tuple[Tensor, HOGSpec, Tensor]:
    """One case: the image, uint8 (1, C, H, W), the spec and VLFeat's descriptor (1, rows, cols, channels)."""
    case = CASES[number]
    image = torch.from_numpy(np.atleast_3d(VLFEAT[f"image_{case['image']}"])).permute(2, 0, 1).unsqueeze(0)
    vote = "linear" if case["bilinearOrientations"] else "hard"
    spec = presets.uoctti(case["cellSize"], vote=vote, orientations=case["numOrientations"])
    return image, spec, torch.from_numpy(VLFEAT[f"output_{number}"]).permute(1, 2, 0).unsqueeze(0)


def name(number: int) -> str:
    case = CASES[number]
    return f"{case['image']}-cell{case['cellSize']}-{'linear' if case['bilinearOrientations'] else 'hard'}"


@pytest.mark.parametrize("number", range(len(CASES)), ids=name)
def test_uoctti_equals_vlfeat(number: int) -> None:
    image, spec, expected = load(number)
    descriptor = hog(image.float() / 255, spec)
    # VLFeat gets the linear weight from a float32 arccosine, which loses digits near the bin centres; the rest is
    # summation order
    tolerance = 1e-4 if spec.vote == "linear" else 1e-6
    torch.testing.assert_close(descriptor, expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("number", range(len(CASES)), ids=name)
def test_linear_votes_are_as_exact_as_the_stored_arccosine_allows(number: int) -> None:
    """In float64 too: the difference to VLFeat is VLFeat's rounding, not ours."""
    image, spec, expected = load(number)
    descriptor = hog(image.double() / 255, spec)
    torch.testing.assert_close(descriptor.float(), expected, rtol=0, atol=1e-4 if spec.vote == "linear" else 1e-6)


@pytest.mark.parametrize("number", range(len(CASES)), ids=name)
def test_bytes_equal_floats(number: int) -> None:
    image, spec, _ = load(number)
    torch.testing.assert_close(hog(image, spec), hog(image.float() / 255, spec), rtol=0, atol=1e-6)


def test_archive_holds_what_its_readme_says() -> None:
    assert len(CASES) == 16
    assert {(c["cellSize"], c["numOrientations"], c["bilinearOrientations"]) for c in CASES} == {
        (8, 9, False),
        (8, 9, True),
        (5, 6, False),
        (5, 6, True),
    }
    assert str(VLFEAT["version"]).startswith("git 1b9075fc")


@pytest.mark.parametrize("number", range(len(CASES)), ids=name)
def test_aubrys_channels_are_vlfeats_undirected_ones_but_for_epsilon(number: int) -> None:
    image, spec, expected = load(number)
    n = spec.bins // 2
    nine = presets.aubry(spec.cell_size, vote=spec.vote, orientations=n)
    normalizer = dataclasses.replace(nine.normalizer, epsilon=1e-4)
    descriptor = hog(image.float() / 255, dataclasses.replace(nine, value_range=255.0, normalizer=normalizer))
    tolerance = 1e-4 if spec.vote == "linear" else 1e-6
    torch.testing.assert_close(descriptor, expected[..., 2 * n : 3 * n], rtol=0, atol=tolerance)
