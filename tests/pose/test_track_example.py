"""The example that follows an object through a video finds it in every frame."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
import torch

import nablahog

from ..chairs import chair

FILE = Path(__file__).parents[2] / "examples" / "track.py"


@pytest.mark.slow
def test_an_object_is_followed() -> None:
    spec = importlib.util.spec_from_file_location("track", FILE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    camera = nablahog.Camera.from_field_of_view(30, 240, 320)
    true = torch.tensor([[40.0 + 6 * k, 15, 3, 0, 4 * k, 0] for k in range(3)])
    estimates = list(example.track(nablahog.render(chair(3), true, camera), chair(3), camera.focal))
    assert max(abs(one.azimuth - float(pose[0])) for one, pose in zip(estimates, true, strict=True)) < 2
    assert max(abs(one.x - float(pose[4])) for one, pose in zip(estimates, true, strict=True)) < 3
