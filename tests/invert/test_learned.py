"""Learned priors: files that contradict themselves are refused, and training neither depends on luck nor on
interruptions."""

from __future__ import annotations

import dataclasses
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import nablahog
from nablahog import LearnedPrior, hog, presets, train_prior
from nablahog.hog.descriptor import histograms
from nablahog.invert import Search, signed_training, training_windows
from nablahog.invert.crops import draw_crops
from nablahog.invert.fitting import default_precision
from nablahog.invert.histograms import recover_histograms
from nablahog.invert.network import weight_count
from nablahog.invert.prior_network import Architecture
from nablahog.invert.provenance import digest_of_weights
from nablahog.invert.signed_network import HISTOGRAM_EVALUATIONS
from nablahog.invert.signed_training import SignedTraining
from nablahog.invert.unsigned_training import UnsignedTraining

from ..io import tiny_models
from ..io.archives import check_refused
from .interruption import Interruption
from .photographs import photograph

SPEC = presets.uoctti(8)
TINY = Architecture((8, 8, 8), (1, 0, 0))
KINDS = {"signed": SPEC, "unsigned": presets.paper(8)}
EPOCHS = 3


# --- files


def _weights(count: int, value: float = 0.0) -> np.ndarray[Any, Any]:
    return np.full(count, value, np.float16)


COUNT = weight_count(SPEC, TINY)
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "NaN": ({"weights": _weights(COUNT, np.nan)}, "the weights must lie within ±65504, got NaN, Inf or more"),
    "Inf": ({"weights": _weights(COUNT, np.inf)}, "the weights must lie within ±65504, got NaN, Inf or more"),
    "too few weights": (
        {"weights": _weights(COUNT - 1)},
        rf"shape \({COUNT},\), got float16 of \({COUNT - 1},\)",
    ),
    "weights of another type": ({"weights": np.zeros(COUNT, np.float32)}, "must be float16, got float32"),
    "an unsigned spec": ({"spec": np.array(presets.paper(8).to_json())}, "the weights must be"),
    "a spec that keeps no signs": ({"spec": np.array(presets.aubry(8).to_json())}, "the weights must be"),
    "other widths": ({"widths": np.array([8, 8, 9])}, "the weights must be"),
    "no widths": ({"widths": np.array([8, 8, 0])}, "widths must be integers of 1 … 1024"),
    "fractional widths": ({"widths": np.array([8.0, 8, 8])}, "widths must be a list of integers, got float64"),
    "more widths": (
        {"widths": np.array([8, 8, 8, 8]), "blocks": np.array([1, 0, 0, 0])},
        r"a prior for signed descriptors has 3 widths, got \(8, 8, 8, 8\)",
    ),
    "more blocks": ({"blocks": np.array([1, 0, 0, 0])}, "as many widths as blocks"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    check_refused(tiny_models.prior(), tmp_path / "p.npz", *WRONG[what])


# --- what to expect


@pytest.mark.parametrize("size", [(64, 64), (43, 50), (8, 8), (61, 9)])
def test_expected_has_the_images_size(size: tuple[int, int]) -> None:
    descriptor = hog(photograph(64)[..., : size[0], : size[1]], SPEC)
    expected = tiny_models.prior().expected(descriptor, SPEC, size)
    assert expected.shape == (1, 1, *size)
    assert expected.dtype == descriptor.dtype
    assert torch.isfinite(expected).all()
    assert float(expected.mean()) == pytest.approx(0.5, abs=1e-4)
    result = nablahog.reconstruct(descriptor, SPEC, size, expected=expected, search=Search(max_evaluations=4))
    assert torch.isfinite(result.image).all()


def test_expected_of_a_batch_is_that_of_each() -> None:
    photographs = torch.cat([photograph(64, name)[..., :44, :] for name in ("camera", "coins")])
    descriptors = hog(photographs, SPEC)
    prior = tiny_models.prior()
    together = prior.expected(descriptors, SPEC, (44, 64))
    alone = [prior.expected(descriptor[None], SPEC, (44, 64)) for descriptor in descriptors]
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-3, rtol=0)


def test_expected_of_the_mirrored_image_is_mirrored() -> None:
    image = photograph(64)
    prior = tiny_models.prior()
    one, other = (prior.expected(hog(each, SPEC), SPEC, (64, 64)) for each in (image, image.flip(3)))
    torch.testing.assert_close(other, one.flip(3), atol=1e-3, rtol=0)


def test_expected_has_the_contrast_of_the_histograms() -> None:
    image = photograph(64)
    expected = tiny_models.prior().expected(hog(image, SPEC), SPEC, (64, 64))
    votes = recover_histograms(hog(image, SPEC), SPEC, (64, 64), max_evaluations=HISTOGRAM_EVALUATIONS)
    own = histograms(expected, SPEC)
    assert float((own * votes).sum() / own.square().sum()) == pytest.approx(1, abs=1e-3)


def test_a_known_contrast_is_kept() -> None:
    """Eq. 7 as printed tells the contrast; half of it is expected at half of it."""
    spec = dataclasses.replace(presets.paper(8), signed=True, bins=18)
    image = photograph(64)
    prior = tiny_models.prior(spec)
    whole, half = (prior.expected(hog(0.5 + c * (image - 0.5), spec), spec, (64, 64)) - 0.5 for c in (1, 0.5))
    torch.testing.assert_close(half, whole / 2, atol=1e-3, rtol=0)


def test_a_flat_image() -> None:
    expected = tiny_models.prior().expected(hog(torch.full((1, 1, 32, 32), 0.3), SPEC), SPEC, (32, 32))
    torch.testing.assert_close(expected, torch.full((1, 1, 32, 32), 0.5))


def test_double_precision_and_the_name() -> None:
    descriptor = hog(photograph(64).double(), SPEC)
    renamed = dataclasses.replace(SPEC, name="mine")
    assert tiny_models.prior().expected(descriptor, renamed, (64, 64)).dtype == torch.float64


def test_what_does_not_fit() -> None:
    prior, descriptor = tiny_models.prior(), hog(photograph(64), SPEC)
    for other in (presets.paper(8), presets.aubry(8)):
        with pytest.raises(ValueError, match=f"learned for signed descriptors, {other.named} descriptor is unsigned"):
            prior.expected(hog(photograph(64), other), other, (64, 64))
    for wrong, size in [(descriptor, (64, 72)), (descriptor[..., :30], (64, 64)), (descriptor[0], (64, 64))]:
        with pytest.raises(ValueError, match="must have shape"):
            prior.expected(wrong, SPEC, size)
    with pytest.raises(ValueError, match="must be finite"):
        prior.expected(descriptor / 0, SPEC, (64, 64))


# --- learning


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> dict[str, Tensor]:
    """Four small photographs, two to a step, whose histograms are found in a hurry."""
    monkeypatch.setattr(training_windows, "BATCH", 2)
    monkeypatch.setattr(signed_training, "HISTOGRAM_EVALUATIONS", 5)
    names = ("camera", "coins", "clock", "brick")
    return {name: photograph(64, name)[0, 0, :40, :48].contiguous() for name in names}


every_kind = pytest.mark.parametrize("kind", KINDS)


def _trained(images: dict[str, Tensor], kind: str = "signed", **options: Any) -> LearnedPrior:
    spec = KINDS[kind]
    return train_prior(images, spec, **{"epochs": EPOCHS, "architecture": TINY, **options})


@every_kind
def test_the_seed_decides(images: dict[str, Tensor], kind: str) -> None:
    first = _trained(images, kind)
    torch.rand(1)  # the global generator does not
    second = _trained(dict(reversed(images.items())), kind)
    assert torch.equal(first.weights, second.weights)
    assert first.learning == second.learning
    assert first.learning.images == ("brick", "camera", "clock", "coins")
    assert len(first.learning.losses) == first.learning.epochs == EPOCHS
    other = _trained(images, kind, seed=1)
    assert not torch.equal(first.weights, other.weights)
    assert _trained({**images, "brick": images["coins"]}, kind).learning.sha256 != first.learning.sha256


@every_kind
def test_the_global_generator_is_left_alone(images: dict[str, Tensor], kind: str) -> None:
    before = torch.get_rng_state()
    _trained(images, kind, epochs=1)
    assert torch.equal(torch.get_rng_state(), before)


def test_training_lowers_the_loss(images: dict[str, Tensor]) -> None:
    losses = _trained(images, epochs=15).learning.losses
    assert sum(losses[-5:]) < 0.95 * sum(losses[:5])


@every_kind
def test_half_precision(images: dict[str, Tensor], kind: str) -> None:
    """Which learns the same, but for rounding."""
    single, half = (_trained(images, kind, precision=precision) for precision in ("float32", "bfloat16"))
    assert half.learning.precision == "bfloat16"
    assert not torch.equal(single.weights, half.weights)
    assert half.learning.losses == pytest.approx(single.learning.losses, rel=0.02)


@every_kind
def test_weights_and_losses_are_not_halved(
    images: dict[str, Tensor], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    training = SignedTraining if kind == "signed" else UnsignedTraining
    own_loss, own_step = training.loss, torch.optim.AdamW.step
    dtypes: set[torch.dtype] = set()

    def loss(self: Any, network: Any, batch: Any) -> Tensor:
        assert torch.is_autocast_enabled("cpu")
        out = own_loss(self, network, batch)
        dtypes.add(out.dtype)
        return out

    def step(optimizer: torch.optim.AdamW, *_: Any) -> None:
        for weight in optimizer.param_groups[0]["params"]:
            dtypes.update((weight.dtype, weight.grad.dtype))
        own_step(optimizer)

    monkeypatch.setattr(training, "loss", loss)
    monkeypatch.setattr(torch.optim.AdamW, "step", step)
    _trained(images, kind, epochs=1, precision="bfloat16")
    assert dtypes == {torch.float32}


def test_half_precision_is_the_default_where_a_gpu_has_instructions_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for supported, expected in ((True, "bfloat16"), (False, "float32")):
        monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation, it=supported: it)
        assert default_precision(torch.device("cuda")) == expected
        assert default_precision(torch.device("cpu")) == "float32"


@every_kind
def test_interrupted_and_resumed(tmp_path: Path, images: dict[str, Tensor], kind: str) -> None:
    path = tmp_path / "kept"
    undisturbed = _trained(images, kind)
    with pytest.raises(KeyboardInterrupt):
        _trained(images, kind, checkpoint=path, progress=Interruption(3))  # of two steps an epoch
    resumed = Interruption()
    result = _trained(images, kind, checkpoint=path, progress=resumed)
    assert resumed.steps == [2, 3, 4, 5, 6]
    assert torch.equal(result.weights, undisturbed.weights)
    assert result.learning == undisturbed.learning
    again = Interruption()
    assert torch.equal(_trained(images, kind, checkpoint=path, progress=again).weights, undisturbed.weights)
    assert again.steps == [6]
    assert os.listdir(tmp_path) == ["kept"]


@every_kind
def test_going_on(tmp_path: Path, images: dict[str, Tensor], kind: str) -> None:
    """From what was learned before; an interruption does not change it."""
    before = torch.get_rng_state()
    start = _trained(images, kind)
    further = _trained(images, kind, start=start, seed=1)
    assert torch.equal(torch.get_rng_state(), before)
    assert further.learning.start == digest_of_weights(start.weights)
    others = start, _trained(images, kind, seed=1)
    moved, apart = (float((further.weights - other.weights).float().norm()) for other in others)
    assert 0 < moved < apart
    with pytest.raises(KeyboardInterrupt):
        _trained(images, kind, start=start, seed=1, checkpoint=tmp_path / "kept", progress=Interruption(3))
    assert torch.equal(
        _trained(images, kind, start=start, seed=1, checkpoint=tmp_path / "kept").weights, further.weights
    )
    path = tmp_path / "prior.npz"
    further.save(path)
    assert LearnedPrior.load(path).learning == further.learning


def test_checkpoints_of_another_training(tmp_path: Path, images: dict[str, Tensor]) -> None:
    path = tmp_path / "kept"
    _trained(images, epochs=1, checkpoint=path)
    for changed, message in [
        ({"seed": 1}, "seed"),
        ({"epochs": 2}, "epochs"),
        ({"architecture": Architecture((8, 8, 9), (1, 0, 0))}, "architecture"),
        ({"precision": "bfloat16"}, "precision"),
        ({"images": {"camera": images["camera"]}}, "images"),
    ]:
        options: dict[str, Any] = {"images": images, "epochs": 1, **changed}
        with pytest.raises(ValueError, match=rf"checkpoint of another training \(of other {message}\)"):
            _trained(checkpoint=path, **options)


def test_damaged_checkpoints(tmp_path: Path, images: dict[str, Tensor], caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "kept"
    undisturbed = _trained(images, epochs=1, checkpoint=path)
    whole = path.read_bytes()
    with np.load(path, allow_pickle=False) as archive:
        arrays = dict(archive)

    def replaced(**changed: Any) -> Callable[[], None]:
        def write() -> None:
            with open(path, "wb") as file:
                np.savez(file, **{**arrays, **changed})

        return write

    damages: list[Callable[[], object]] = [
        lambda: path.write_bytes(whole[: len(whole) // 2]),
        lambda: path.write_bytes(b""),
        replaced(state=arrays["state"][1:]),
        replaced(state=arrays["state"] * np.float32(np.nan)),
        replaced(losses=np.array("x")),
        replaced(losses=np.zeros(2)),
        replaced(losses=np.zeros(0)),
        replaced(identity=np.array("{}")),
        replaced(identity=np.array([{}], dtype=object)),
    ]
    for damage in damages:
        damage()
        damaged = path.read_bytes()
        caplog.clear()
        assert torch.equal(_trained(images, epochs=1, checkpoint=path).weights, undisturbed.weights)
        assert caplog.messages == [f"{path} is damaged: it is now called kept.damaged, and the training starts afresh"]
        assert path.with_name("kept.damaged").read_bytes() == damaged


def test_what_cannot_be_learned_from(images: dict[str, Tensor]) -> None:
    camera, start = images["camera"], _trained(images, "unsigned", epochs=1)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:31]}}, "a: expected at least 32x32 pixels, got 31x48"),
        ({"images": {"a": camera * 255}}, "a: expected an image"),
        ({"images": {"a": camera.double()}}, "a: expected an image"),
        ({"images": {"a": camera * torch.nan}}, "a: expected an image"),
        ({"images": {"a": camera[None]}}, "a: expected an image"),
        ({"epochs": 0}, "epochs must be at least 1, got 0"),
        ({"precision": "float16"}, "precision must be one of 'float32', 'bfloat16', got 'float16'"),
        ({"architecture": Architecture((8, 8), (0, 0))}, "a prior for signed descriptors has 3 widths"),
        ({"kind": "unsigned", "architecture": Architecture((8, 8), (0, 0))}, "unsigned descriptors has 3 widths"),
        ({"start": start}, "the prior was learned for unsigned descriptors, a uoctti descriptor is signed"),
        (
            {"kind": "unsigned", "start": start, "architecture": Architecture((8, 8, 9), (1, 0, 0))},
            "the prior to go on from is of Architecture",
        ),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            _trained(**{"images": images, **changed})


@pytest.mark.parametrize("cell_size", [2, 3, (8, 4), 32])
def test_cells_of_any_size(cell_size: int | tuple[int, int]) -> None:
    spec = presets.uoctti(cell_size)
    image = photograph(64)[..., :50, :60]
    expected = tiny_models.prior().expected(hog(image, spec), spec, (50, 60))
    assert expected.shape == image.shape
    assert torch.isfinite(expected).all()


def test_crops() -> None:
    large = photograph(64).expand(-1, -1, -1, 64)[0, 0].repeat(3, 5)  # 192x320
    for images in ([large, large], [large, large[:32, :40]]):
        for seed in range(20):
            crops = draw_crops(images, 8, random.Random(seed))
            assert crops.shape[:2] == (2, 1)
            assert all(16 < side <= 128 for side in crops.shape[2:])
            assert 0 <= crops.min() <= crops.max() <= 1
