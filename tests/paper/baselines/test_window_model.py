"""What HOGgles, ridge regression and nearest neighbours have in common."""

from __future__ import annotations

import dataclasses
from functools import cache

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets
from nablahog.paper.baselines.hoggles_learning import learn_hoggles
from nablahog.paper.baselines.nearest import learn_nearest
from nablahog.paper.baselines.ridge import learn_ridge
from nablahog.paper.baselines.window_model import WindowModel

from ...invert.photographs import photograph

SPEC = presets.uoctti((4, 3), orientations=3)
SIZE = (47, 50)  # of no whole cells
NOUNS = {"hoggles": "dictionary", "ridge": "regression", "nearest": "database"}

every_kind = pytest.mark.parametrize("kind", NOUNS)


@cache
def _model(kind: str) -> WindowModel:
    images = {name: photograph(64, name)[0, 0, : SIZE[0], : SIZE[1]].contiguous() for name in ("coins", "clock")}
    if kind == "hoggles":
        return learn_hoggles(images, SPEC, atoms=40, fast=True)
    return learn_ridge(images, SPEC) if kind == "ridge" else learn_nearest(images, SPEC)


@cache
def _descriptors() -> Tensor:
    names = ("camera", "coffee", "astronaut")
    return hog(torch.cat([photograph(64, name)[..., : SIZE[0], : SIZE[1]] for name in names]), SPEC)


@every_kind
def test_a_batch_is_its_images(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = _model(kind)
    monkeypatch.setattr(type(model), "_batch_size", lambda self, rows, cols: 2)
    seen: list[tuple[int, int]] = []
    together = model.reconstruct(_descriptors(), SPEC, SIZE, progress=lambda *at: seen.append(at))
    assert seen == [(0, 3), (2, 3), (3, 3)]
    for k in range(3):
        alone = model.reconstruct(_descriptors()[k : k + 1], SPEC, SIZE)
        torch.testing.assert_close(together.image[k : k + 1], alone.image, atol=1e-4, rtol=0)
        torch.testing.assert_close(together.distance[k : k + 1], alone.distance, atol=1e-4, rtol=0)
    assert together.image.shape == (3, 1, *SIZE)
    assert 0 <= together.image.min() <= together.image.max() <= 1
    assert together.history.shape == (0, 3)
    assert together.evaluations.tolist() == [0, 0, 0]
    assert len(together.stop_reason) == 3


@every_kind
def test_double_precision_and_the_distance(kind: str) -> None:
    descriptor = _descriptors()[:1].double()
    result = _model(kind).reconstruct(descriptor, SPEC, SIZE)
    assert result.image.dtype == result.distance.dtype == result.history.dtype == torch.float64
    assert torch.equal(result.image.float(), _model(kind).reconstruct(descriptor.float(), SPEC, SIZE).image)
    expected = (hog(result.image, SPEC) - descriptor).norm() / descriptor.norm()
    assert float(result.distance[0]) == pytest.approx(float(expected), rel=1e-5)
    assert 0.1 < float(result.distance[0]) < 1


@every_kind
def test_whole_cells_by_default(kind: str) -> None:
    assert _model(kind).reconstruct(_descriptors()[:1], SPEC).image.shape == (1, 1, 48, 51)


@pytest.mark.parametrize("kind", ["ridge", "nearest"])  # HOGgles stretches what it cuts off, too
def test_images_are_stretched(kind: str) -> None:
    image = _model(kind).reconstruct(_descriptors()[:1], SPEC, SIZE).image
    assert (float(image.min()), float(image.max())) == (0, 1)


@every_kind
def test_what_does_not_fit(kind: str) -> None:
    model, descriptor = _model(kind), _descriptors()[:1]
    noun = NOUNS[kind]
    with pytest.raises(ValueError, match=rf"the {noun} was learned for another spec: its cell_size is \(4, 3\)"):
        model.reconstruct(descriptor, presets.uoctti(4, orientations=3))
    renamed = dataclasses.replace(SPEC, name="mine")
    assert torch.equal(model.reconstruct(descriptor, renamed).image, model.reconstruct(descriptor, SPEC).image)
    with pytest.raises(ValueError, match="must have shape"):
        model.reconstruct(descriptor, SPEC, (64, 72))
    with pytest.raises(ValueError, match="must be finite"):
        model.reconstruct(descriptor * torch.nan, SPEC)
    with pytest.raises(TypeError, match="must be a float32 or float64 tensor, got ndarray"):
        model.reconstruct(descriptor.numpy(), SPEC)  # type: ignore[arg-type]
