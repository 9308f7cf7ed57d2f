"""The up-convolutional network: files that contradict themselves are refused, images are the network's own, and
training neither depends on luck nor on interruptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.io.network_weights import count
from nablahog.paper.baselines.upconv import Upconv
from nablahog.paper.baselines.upconv_learning import UpconvTraining, learn_upconv
from nablahog.paper.baselines.upconv_network import (
    CELLS,
    UpconvNetwork,
    check_widths,
    default_widths,
    input_channels,
    network_input,
)

from ...invert.photographs import photograph
from ...io import tiny_models
from ...io.archives import check_refused

SPECS = {"uoctti": presets.uoctti(8), "paper": presets.paper(8)}
SPEC = SPECS["uoctti"]
TINY = (8, 4, 4, 2)
EPOCHS = 3

every_spec = pytest.mark.parametrize("spec", SPECS.values(), ids=list(SPECS))


# --- files

COUNT = count(lambda: UpconvNetwork(SPEC, TINY))
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "NaN": ({"weights": np.full(COUNT, np.nan, np.float16)}, "the weights must lie within ±65504, got NaN"),
    "too few weights": ({"weights": np.zeros(COUNT - 1, np.float16)}, rf"of shape \({COUNT},\), got float16 of"),
    "weights of another type": ({"weights": np.zeros(COUNT, np.float32)}, "must be float16, got float32"),
    "other cells": ({"spec": np.array(presets.uoctti(4).to_json())}, "4 widths do not lead from cells of 4 pixels"),
    "oblong cells": ({"spec": np.array(presets.uoctti((8, 4)).to_json())}, "square cells of .* only, got 8x4"),
    "blocks": ({"spec": np.array(presets.opencv().to_json())}, "descriptors of single cells only"),
    "another descriptor": ({"spec": np.array(presets.paper(8).to_json())}, "the weights must be float16 of shape"),
    "other widths": ({"widths": np.array([8, 4, 4, 3])}, "the weights must be float16 of shape"),
    "no channels": ({"widths": np.array([8, 4, 4, 0])}, "widths must be integers of 1 … 1024"),
    "too many channels": ({"widths": np.array([8, 4, 4, 1025])}, "widths must be integers of 1 … 1024"),
    "no widths": ({"widths": np.zeros(0, int)}, "0 widths do not lead from cells of 8 pixels"),
    "fractional widths": ({"widths": np.array([8.0, 4, 4, 2])}, "widths must be a list of integers, got float64"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    check_refused(tiny_models.upconv(), tmp_path / "u.npz", *WRONG[what])


# --- the network


def test_default_sizes() -> None:
    for cell in CELLS:
        spec = presets.uoctti(cell)
        check_widths(spec, default_widths(spec))
    for spec in SPECS.values():
        assert 3e6 < count(lambda spec=spec: UpconvNetwork(spec, default_widths(spec))) < 6e6


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("cells", [(1, 1), (3, 5), (4, 2)])
def test_images_of_all_cells(cell: int, cells: tuple[int, int]) -> None:
    spec = presets.uoctti(cell)
    widths = (4,) * cell.bit_length()
    image = UpconvNetwork(spec, widths)(torch.rand(2, 31, *cells))
    assert torch.equal(image, torch.full((2, 1, cells[0] * cell, cells[1] * cell), 0.5))  # before training


def test_a_cell_decides_what_is_around_it() -> None:
    """The gradient of the image in a cell reaches distant cells, and with respect to the same cell is largest."""
    network = tiny_models.upconv()._network
    cells = torch.rand(1, 31, 16, 16, requires_grad=True)
    network(cells)[0, 0, 64:72, 64:72].sum().backward()
    assert cells.grad is not None
    size = cells.grad.abs().sum(dim=(0, 1))
    assert size.argmax() == 8 * 16 + 8
    assert size[8, 12] > 0


def test_the_scale_of_the_printed_form_is_told() -> None:
    """Eq. 7 as printed knows the contrast c: the channel is proportional to its root, whatever the image's size."""
    spec, image = presets.paper(8), photograph(64)
    whole, half, twice = (
        network_input(hog(each, spec), spec, *each.shape[2:])
        for each in (image, 0.5 + 0.5 * (image - 0.5), image.repeat(1, 1, 2, 2))
    )
    assert whole.shape == (1, input_channels(spec), 8, 8) == (1, 10, 8, 8)
    torch.testing.assert_close(half[:, :9], whole[:, :9], atol=1e-3, rtol=1e-3)
    scale, of_half, of_twice = (float(each[0, 9, 0, 0]) for each in (whole, half, twice))
    assert of_half == pytest.approx(scale * 0.5**0.5, rel=1e-3)
    assert of_twice == pytest.approx(scale, rel=0.1)  # but for the seams


# --- inversion


@every_spec
@pytest.mark.parametrize("size", [(64, 64), (43, 50), (8, 8), (61, 17)])
def test_images_have_their_size(spec: HOGSpec, size: tuple[int, int]) -> None:
    descriptor = hog(photograph(64)[..., : size[0], : size[1]], spec)
    model = tiny_models.upconv(spec)
    image = model.reconstruct(descriptor, spec, size).image
    assert image.shape == (1, 1, *size)
    whole = model._network(network_input(descriptor, spec, *size))
    assert torch.equal(image, whole[..., : size[0], : size[1]].clamp(0, 1))  # neither stretched nor matched


@every_spec
def test_flat_images(spec: HOGSpec) -> None:
    result = tiny_models.upconv(spec).reconstruct(hog(torch.full((1, 1, 32, 40), 0.3), spec), spec)
    assert result.image.isfinite().all()
    assert result.distance.isfinite().all()


def test_a_batch_is_its_images() -> None:
    model, descriptors = tiny_models.upconv(), hog(torch.rand(10, 1, 24, 32), SPEC)
    together = model.reconstruct(descriptors, SPEC).image
    alone = [model.reconstruct(each[None], SPEC).image for each in descriptors]
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-5, rtol=0)


def test_what_does_not_fit() -> None:
    model, descriptor = tiny_models.upconv(), hog(photograph(64), SPEC)
    with pytest.raises(ValueError, match="the network was learned for another spec: its value_range is 255"):
        model.reconstruct(hog(photograph(64), SPECS["paper"]), SPECS["paper"])
    with pytest.raises(ValueError, match="must be finite"):
        model.reconstruct(descriptor * torch.nan, SPEC)


# --- learning


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> dict[str, Tensor]:
    """Four small photographs, two to a step."""
    monkeypatch.setattr(UpconvTraining, "batch", 2)
    names = ("camera", "coins", "clock", "brick")
    return {name: photograph(64, name)[0, 0, :40, :48].contiguous() for name in names}


def _learned(images: dict[str, Tensor], **options: Any) -> Upconv:
    return learn_upconv(images, **{"spec": SPEC, "epochs": EPOCHS, "widths": TINY, **options})


@every_spec
def test_the_seed_decides(images: dict[str, Tensor], spec: HOGSpec) -> None:
    before = torch.get_rng_state()
    first = _learned(images, spec=spec)
    assert torch.equal(torch.get_rng_state(), before)
    torch.rand(1)  # the global generator does not
    second = _learned(dict(reversed(images.items())), spec=spec)
    assert torch.equal(first.weights, second.weights)
    assert first.learning == second.learning
    assert first.learning.images == ("brick", "camera", "clock", "coins")
    assert len(first.learning.losses) == first.learning.epochs == EPOCHS
    assert not torch.equal(_learned(images, spec=spec, seed=1).weights, first.weights)


@every_spec
def test_training_lowers_the_error(images: dict[str, Tensor], spec: HOGSpec) -> None:
    """Below that of the best constant, which is the variance of the photographs."""
    model = _learned(images, spec=spec, epochs=80, widths=(32, 16, 8, 8))
    assert sum(model.learning.losses[-5:]) < 0.7 * sum(model.learning.losses[:5])
    pixels = torch.stack(list(images.values()))[:, None]
    result = model.reconstruct(hog(pixels, spec), spec, (40, 48)).image
    assert (result - pixels).square().mean() < 0.7 * pixels.var(correction=0)


@pytest.mark.parametrize(
    ("changed", "message"), [({"widths": (8, 4, 4, 3)}, "architecture"), ({"spec": SPECS["paper"]}, "spec")]
)
def test_checkpoint_of_another_training(
    tmp_path: Path, images: dict[str, Tensor], changed: dict[str, Any], message: str
) -> None:
    _learned(images, epochs=1, checkpoint=tmp_path / "kept")
    with pytest.raises(ValueError, match=rf"checkpoint of another training \(of other {message}\)"):
        _learned(images, epochs=1, checkpoint=tmp_path / "kept", **changed)


def test_epochs_by_default(images: dict[str, Tensor], monkeypatch: pytest.MonkeyPatch) -> None:
    """Two steps of two crops each."""
    monkeypatch.setattr(UpconvTraining, "default_crops", 9)
    assert _learned(images, epochs=None).learning.epochs == 2


def test_what_cannot_be_learned_from(images: dict[str, Tensor]) -> None:
    camera = images["camera"]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:31]}}, "a: expected at least 32x32 pixels, got 31x48"),
        ({"images": {"a": camera * torch.nan}}, "a: expected an image"),
        ({"epochs": 0}, "epochs must be at least 1, got 0"),
        ({"widths": (8, 4, 4)}, "3 widths do not lead from cells of 8 pixels"),
        ({"spec": presets.opencv(), "widths": None}, "descriptors of single cells only, unlike opencv"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            _learned(**{"images": images, **changed})
