"""Training of priors: it depends on neither chance nor interruptions, and keeps held-out images apart."""

from __future__ import annotations

import math
import random
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d
from torch.testing import assert_close

from nablahog import LearnedPrior, hog, presets, train_prior
from nablahog.hog import HOGSpec
from nablahog.invert import histograms
from nablahog.invert.prior import calibration, training_windows
from nablahog.invert.prior.calibration import Observations
from nablahog.invert.prior.confidence import Calibration, SignEvidence, smooth_regions
from nablahog.invert.prior.provenance import digest_of_weights
from nablahog.invert.prior.signed_network import Architecture, ResidualBlock
from nablahog.invert.prior.training import default_precision, learning_rates
from nablahog.invert.prior.training_windows import HELD_OUT, SignedTraining, UnsignedTraining, WindowTraining
from nablahog.invert.prior.unsigned_network import UnsignedNetwork
from nablahog.io.learned_model import fold_statistics, unfold_statistics

from ..interruption import Interruption
from ..io import tiny_models
from .photographs import photograph

PAPER = presets.paper(8)
KINDS = {"signed": presets.uoctti(8), "unsigned": PAPER}
every_kind = pytest.mark.parametrize("kind", KINDS)
TINY = Architecture((8, 8, 8), (1, 0, 0))
EPOCHS = 3


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> dict[str, Tensor]:
    """Four small photographs, two to a step, whose histograms are found in a hurry."""
    monkeypatch.setattr(training_windows, "WINDOWS_PER_BATCH", 2)
    monkeypatch.setattr(histograms, "AFTER_CLOSED_FORM", 5)
    names = ("camera", "coins", "clock", "brick")
    return {name: photograph(64, name)[0, 0, :40, :48].contiguous() for name in names}


def trained(images: dict[str, Tensor], kind: str = "signed", **options: Any) -> LearnedPrior:
    return train_prior(images, KINDS[kind], **{"epochs": EPOCHS, "architecture": TINY, **options})


# --- the loop


@pytest.mark.slow
def test_the_learning_rate_rises_in_a_tenth_and_falls_by_half_cosines() -> None:
    for steps in (100, 250):
        optimizer = torch.optim.AdamW([nn.Parameter(torch.zeros(1))], 1.0)
        schedule, rates = learning_rates(optimizer, 2.0, steps), []
        for _ in range(steps):
            rates.append(schedule.get_last_lr()[0])
            optimizer.step()
            schedule.step()
        peak, last = steps // 10 - 1, steps - 1
        for step, rate in enumerate(rates):
            low, done = (1 / 25, step / peak) if step <= peak else (1e-5, (last - step) / (last - peak))
            assert rate == pytest.approx(2 * (low + (1 - low) * (1 - math.cos(math.pi * done)) / 2))


@pytest.mark.slow
@every_kind
def test_an_interrupted_training_is_resumed_with_the_same_result(
    tmp_path: Path, images: dict[str, Tensor], kind: str
) -> None:
    path, before = tmp_path / "kept", torch.get_rng_state()
    undisturbed = trained(images, kind)
    assert torch.equal(torch.get_rng_state(), before)
    with pytest.raises(KeyboardInterrupt):
        trained(images, kind, checkpoint=path, progress=Interruption(3))  # of two steps an epoch
    resumed, again = Interruption(), Interruption()
    result = trained(images, kind, checkpoint=path, progress=resumed)
    assert resumed.steps == [2, 3, 4, 5, 6]
    assert torch.equal(result.weights, undisturbed.weights)
    assert result.learning == undisturbed.learning
    assert torch.equal(trained(images, kind, checkpoint=path, progress=again).weights, undisturbed.weights)
    assert again.steps == [6]
    assert [file.name for file in tmp_path.iterdir()] == ["kept"]


@pytest.mark.slow
def test_the_seed_and_the_images_decide(images: dict[str, Tensor]) -> None:
    first, second = trained(images), trained(dict(reversed(images.items())))
    assert torch.equal(first.weights, second.weights)
    assert first.learning == second.learning
    assert first.learning.images == ("brick", "camera", "clock", "coins")
    other = trained(images, seed=1, precision="bfloat16")
    assert not torch.equal(first.weights, other.weights)
    assert other.learning.precision == "bfloat16"
    assert trained({**images, "brick": images["coins"]}).learning.sha256 != first.learning.sha256


@pytest.mark.slow
def test_training_lowers_the_loss_in_either_precision(images: dict[str, Tensor]) -> None:
    losses = trained(images, epochs=15).learning.losses
    assert sum(losses[-5:]) < 0.95 * sum(losses[:5])
    single, half = (trained(images, precision=p).learning.losses for p in ("float32", "bfloat16"))
    assert half == pytest.approx(single, rel=0.05)
    assert half != single


def test_bfloat16_is_the_default_where_a_gpu_has_instructions_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for supported, expected in ((True, "bfloat16"), (False, "float32")):
        monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation, it=supported: it)
        assert default_precision(torch.device("cuda")) == expected
        assert default_precision(torch.device("cpu")) == "float32"


@pytest.mark.slow
def test_going_on_from_another_prior(tmp_path: Path, images: dict[str, Tensor]) -> None:
    start = trained(images)
    further = trained(images, start=start, seed=1)
    assert further.learning.start == digest_of_weights(start.weights)
    anew = trained(images, seed=1)
    moved, apart = (float((further.weights - other.weights).float().norm()) for other in (start, anew))
    assert 0 < moved < apart
    with pytest.raises(KeyboardInterrupt):
        trained(images, start=start, seed=1, checkpoint=tmp_path / "kept", progress=Interruption(3))
    resumed = trained(images, start=start, seed=1, checkpoint=tmp_path / "kept")
    assert torch.equal(resumed.weights, further.weights)


def test_checkpoints_of_another_training_and_damaged_ones_are_refused(
    tmp_path: Path, images: dict[str, Tensor]
) -> None:
    path = tmp_path / "kept"
    start = trained(images, epochs=1, checkpoint=path)
    changes: dict[str, Any] = {
        "images": images | {"brick": images["coins"]},
        "spec": presets.uoctti(4),
        "epochs": 2,
        "seed": 1,
        "architecture": Architecture((8, 8, 16), (1, 0, 0)),
        "precision": "bfloat16",
        "start": start,
    }
    for name, value in changes.items():
        options = {"images": images, "spec": KINDS["signed"], "epochs": 1, "architecture": TINY, name: value}
        with pytest.raises(ValueError, match=rf"checkpoint of another training \(with other {name}\)"):
            train_prior(**options, checkpoint=path)
    whole = path.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"x" * 1000):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="no checkpoint of a training"):
            trained(images, epochs=1, checkpoint=path)


@pytest.mark.parametrize(("kind", "windows"), [("signed", 90_000), ("unsigned", 300_000)])
def test_windows_of_a_training_by_default(
    images: dict[str, Tensor], monkeypatch: pytest.MonkeyPatch, kind: str, windows: int
) -> None:
    monkeypatch.setattr(WindowTraining, "batches", lambda self, epoch: iter([None]))
    totals: list[int] = []

    def stop(done: int, total: int, what: str) -> None:
        totals.append(total)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trained(images, kind, epochs=None, progress=stop)
    monkeypatch.setattr({"signed": SignedTraining, "unsigned": UnsignedTraining}[kind], "default_crops", 1)
    with pytest.raises(KeyboardInterrupt):
        trained(images, kind, epochs=None, progress=stop)
    assert totals == [windows // 2, 2]  # of two to a step; at least one epoch


def test_what_cannot_be_learned_from(images: dict[str, Tensor]) -> None:
    camera, start = images["camera"], trained(images, "unsigned", epochs=1)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:31]}}, "a must have at least 32x32 pixels, got 31x48"),
        ({"images": {"a": camera * 255}}, "a must have gray values in 0…1"),
        ({"images": {"a": camera * torch.nan}}, "a must .* got nan"),
        ({"epochs": 0}, "epochs must be an integer of at least 1"),
        ({"precision": "float16"}, "precision must be one of"),
        ({"architecture": Architecture((8, 8), (0, 0))}, "a prior for signed descriptors has 3 widths"),
        ({"start": start}, "the prior is for unsigned descriptors"),
        ({"kind": "unsigned", "start": start, "architecture": Architecture((8, 8, 9), (1, 0, 0))}, "start must have"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            trained(**{"images": images, **changed})


def test_a_training_that_diverges_ends(
    tmp_path: Path, images: dict[str, Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = torch.ones(2, 18, 4, 4)
    monkeypatch.setattr(SignedTraining, "_compute_histograms", lambda _, windows, spec: cells[: len(windows)])
    monkeypatch.setattr(SignedTraining, "grids", [(4, 4)])
    assert trained(images, epochs=1).learning.losses[0] < 100
    monkeypatch.setattr(SignedTraining, "learning_rate", 1e30)
    with pytest.raises(ValueError, match="has diverged in epoch 1: the loss is"):
        trained(images, checkpoint=tmp_path / "kept")
    assert not any(tmp_path.iterdir())


# --- means and variances as a part of the weights


def block() -> ResidualBlock:
    """A block that has seen inputs, and whose weights are no longer those of the beginning."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        made = ResidualBlock(6)
        for weights in made.parameters():
            nn.init.normal_(weights)
        for _ in range(100):
            made(2 * torch.randn(4, 6, 8, 8) - 1)
    return made.eval()


@torch.no_grad()
def test_statistics_are_folded_into_the_weights_and_out_of_them() -> None:
    inputs = 3 * torch.randn(4, 6, 8, 8, generator=torch.Generator().manual_seed(0)) + 1
    made = block()
    before = made(inputs)
    fold_statistics(made)
    assert_close(made.normalise_a.running_mean, torch.zeros(6))
    assert_close(made(inputs), before, rtol=1e-4, atol=1e-4)
    unfold_statistics(made, lambda: made(inputs))
    assert not any(layer._forward_pre_hooks for layer in made.modules())
    assert made.training
    assert float(made.normalise_a.running_mean.abs().min()) > 0.1
    assert_close(made(inputs), before, rtol=1e-3, atol=1e-3)  # those of the batch are those that were taken
    assert_close(made.eval()(inputs), before, rtol=2e-2, atol=2e-2)  # after another update of the running ones


# --- windows, and what the networks are trained with


def patches(count: int) -> dict[str, Tensor]:
    """Of one photograph, (64, 64) each."""
    whole = photograph(512)[0, 0]
    places = torch.randint(whole.shape[0] - 64, (count, 2), generator=torch.Generator().manual_seed(0))
    return {str(k): whole[top : top + 64, left : left + 64] for k, (top, left) in enumerate(places.tolist())}


def network() -> UnsignedNetwork:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return UnsignedNetwork(Architecture((8, 8, 8), (0, 0, 0))).eval()


def test_images_held_out_are_not_trained_with(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_windows, "WINDOWS_PER_BATCH", 4)
    held_out = range(HELD_OUT // 2, 50, HELD_OUT)
    images = {name: image * torch.nan if int(name) in held_out else image for name, image in patches(50).items()}
    training = UnsignedTraining(images, 0)
    assert (len(training.held_out), len(training.images), training.crops) == (2, 48, 48)
    assert all(torch.isfinite(part).all() for batch in training.batches(0) for part in batch)
    monkeypatch.setattr(training_windows, "WINDOWS_PER_BATCH", 1)
    assert {len(part) for part in next(training.batches(0))} == {1}


def test_images_of_large_folders_are_drawn_less_often_each_and_large_images_more_often(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """81 dark images in a folder, 9 bright ones of four times their side in another: two windows in five are bright."""
    none = torch.zeros(1, 18, 4, 4)
    monkeypatch.setattr(
        SignedTraining, "_compute_histograms", lambda _, windows, spec: none.repeat(len(windows), 1, 1, 1)
    )
    monkeypatch.setattr(SignedTraining, "grids", [(4, 4)])
    dark, bright = torch.zeros(32, 32), torch.ones(128, 128)
    training = SignedTraining({f"dark/{k}": dark for k in range(81)} | {f"bright/{k}": bright for k in range(9)}, 0)
    windows = torch.cat([batch.windows for epoch in range(12) for batch in training.batches(epoch)])
    assert float(windows.mean()) == pytest.approx(2 / 5, abs=0.06)


@pytest.mark.parametrize("specs", UnsignedTraining.dialects[-4:], ids=lambda specs: specs[1].name)
def test_votes_of_unsigned_dialects_come_with_the_images(monkeypatch: pytest.MonkeyPatch, specs: list[HOGSpec]) -> None:
    """There are more votes where the image has edges."""
    monkeypatch.setattr(UnsignedTraining, "dialects", [specs])
    monkeypatch.setattr(UnsignedTraining, "grids", [(8, 12)])
    batch = next(UnsignedTraining(patches(40), 0).batches(0))
    rows, cols = batch.histograms.shape[2:]
    assert batch.images.shape == (32, 1, 2 * rows, 2 * cols)
    contrast = avg_pool2d(batch.images.square(), 2) - avg_pool2d(batch.images, 2).square()
    for part, spec in zip(torch.arange(32).chunk(len(specs)), specs, strict=True):
        votes, edges = (x[part].log1p().flatten() for x in (batch.histograms.sum(dim=1, keepdim=True), contrast))
        if spec.name != "maskfeat":  # whose cells have all the same contrast
            assert float(torch.corrcoef(torch.stack([votes, edges]))[0, 1]) > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("specs", SignedTraining.dialects[2:], ids=lambda specs: "-".join(s.name for s in specs))
def test_histograms_of_signed_dialects_come_with_the_windows(
    monkeypatch: pytest.MonkeyPatch, specs: list[HOGSpec]
) -> None:
    """They integrate to an image like the window, of the same sign."""
    monkeypatch.setattr(SignedTraining, "dialects", [specs])
    batch = next(SignedTraining({str(k): photograph(128)[0, 0] for k in range(8)}, 0).batches(0))
    each = [torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1] for a, b in zip(*batch[1:], strict=True)]
    assert min(map(float, each)) > 0.6


def test_windows_turned_by_nothing_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"TURNED_SHARE": 1.0, "MAX_TURN": 0.0, "MAX_STRETCH": 0.0}.items():
        monkeypatch.setattr(training_windows, name, value)
    windows = torch.rand(3, 1, 16, 24, generator=torch.Generator().manual_seed(0))
    assert_close(training_windows._turn(windows, random.Random(0)), windows, atol=1e-4, rtol=0)


def test_windows_are_turned_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spots stay as far from the middle as they are, of windows that are not square."""
    monkeypatch.setattr(training_windows, "TURNED_SHARE", 1.0)
    monkeypatch.setattr(training_windows, "MAX_STRETCH", 0.0)
    rng = random.Random(0)
    monkeypatch.setattr(rng, "uniform", lambda low, high: high)
    y, x = torch.meshgrid(torch.arange(64) - 31.5, torch.arange(96) - 47.5, indexing="ij")
    for down, right in ((0, 30), (20, 0), (15, 25)):
        spot = torch.exp(-((y - down) ** 2 + (x - right) ** 2) / 8)
        turned = training_windows._turn(spot[None, None], rng)[0, 0]
        at = [float((turned * axis).sum() / turned.sum()) for axis in (y, x)]
        assert math.hypot(*at) == pytest.approx(math.hypot(down, right), abs=0.2)
        angle = math.degrees(math.atan2(at[0], at[1]) - math.atan2(down, right))
        assert abs(angle) == pytest.approx(12, abs=0.5)


def test_windows_are_enlarged_only_from_photographs_that_are_too_small() -> None:
    training, rng = SignedTraining({"only": photograph(64)[0, 0]}, 0), random.Random(0)
    assert all(1 <= training._scale(3.0, rng) <= 3 for _ in range(50))
    assert training._scale(0.5, rng) == 0.5
    assert training._window(torch.rand(300, 40), (4, 6), rng).shape == (1, 1, 32, 48)


def test_the_loss_of_a_signed_network_is_zero_for_the_window_itself(images: dict[str, Tensor]) -> None:
    """The mean image costs 1 and its lost structure, the negative 4 and more."""
    training = SignedTraining(images, 0)
    batch = next(training.batches(0))
    windows = batch.windows - batch.windows.mean(dim=(2, 3), keepdim=True)
    unit = windows / windows.std(dim=(2, 3), keepdim=True, correction=0)
    own, mean, negative = (float(training.loss(lambda cells, integral, k=k: k * unit, batch)) for k in (1, 0, -1))
    assert own == pytest.approx(0, abs=1e-5)
    assert 1 < mean < 1.5
    assert 4.2 < negative < 5


@pytest.mark.parametrize(("grid", "known"), [((8, 8), False), ((24, 24), True)])
def test_the_loss_of_regions_is_the_same_for_their_negative_unless_the_sign_is_known(
    monkeypatch: pytest.MonkeyPatch, grid: tuple[int, int], known: bool
) -> None:
    """The polarity tells it of the largest cells; of smaller ones the prediction for larger ones has told it."""
    monkeypatch.setattr(UnsignedTraining, "grids", [grid])
    training, made = UnsignedTraining(patches(4), 0), network()
    batch = next(training.batches(0))
    truth, size = batch.images, float(batch.images.square().mean())
    made.coarser = lambda votes, largest: torch.zeros_like(truth)  # type: ignore[method-assign]
    made.polarity.forward = (  # type: ignore[method-assign]
        lambda votes, regions, images: 1e3 * (images * truth).mean(dim=(1, 2, 3))
    )

    def loss(regions: Tensor) -> float:
        made.forward = lambda votes, coarser: regions  # type: ignore[method-assign]
        return float(training.loss(made, batch))

    assert loss(truth) == pytest.approx(0, abs=1e-6)
    assert loss(-truth) == pytest.approx(4 * size if known else 0, rel=1e-4, abs=1e-6)
    assert loss(truth.flip(2)) > 0.1
    made.polarity.forward = lambda *shown: torch.zeros(len(truth))  # type: ignore[method-assign]
    assert loss(truth) == pytest.approx(0 if known else math.log(2), abs=1e-6)


def test_whole_folders_are_held_out_and_calibrate_the_confidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 50 folders two; of one folder of images one in 25, of which eight are needed."""
    several = patches(100)
    in_folders = {f"{int(name) % 50:02}/{name}": image for name, image in several.items()}
    training = UnsignedTraining(in_folders, 0)
    assert {name.partition("/")[0] for name in training.held_out} == {"12", "37"}
    assert (len(training.held_out), len(training.images)) == (4, 96)
    judged: list[list[str]] = []

    def observe(prior: LearnedPrior, photographs: dict[str, Tensor]) -> Observations:
        judged.append(list(photographs))
        return observations(torch.full((8,), 2.0), right=0.75)

    monkeypatch.setattr(calibration, "observe", observe)
    monkeypatch.setattr(training_windows, "WINDOWS_PER_BATCH", 2)
    monkeypatch.setattr(histograms, "AFTER_CLOSED_FORM", 2)
    few = {name: image[:40, :40] for name, image in list(several.items())[:4]}
    assert trained(few, "unsigned", epochs=1).learning.calibration == ()
    assert judged == []
    eight = {str(k): several["0"] for k in range(8)}
    prior = calibration.calibrate(tiny_models.prior(PAPER), eight)
    assert judged == [list(eight)]
    assert prior.learning.calibrated_on == tuple(eight)
    assert float(prior.calibration.polarity(torch.tensor(2.0))) == pytest.approx(0.75, abs=0.01)


def test_what_a_calibration_observes_of_photographs(monkeypatch: pytest.MonkeyPatch) -> None:
    """One pre-image is the photograph, one its negative, one a negative on a side."""
    shown = {name: photograph(64, name[2:])[0, 0, :40] for name in ("a/camera", "a/coins", "b/clock")}
    wholes = [training_windows.resize_whole(image) for image in shown.values()]
    sided = torch.where(torch.arange(128) < 24, 1 - wholes[2], wholes[2])
    images, right, prior = [wholes[0], 1 - wholes[1], sided], [True, False, True], tiny_models.prior(PAPER)
    evidence = [SignEvidence(torch.tensor([k - 1.0]), torch.rand(1, 1, 16, 32)) for k in range(3)]
    given: list[Any] = []

    def invert(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], **options: Any) -> SimpleNamespace:
        assert (size, options["prior"]) == ((64, 128), prior)
        return SimpleNamespace(image=images[len(given)])

    def gather(_: LearnedPrior, *of: Any) -> SignEvidence:
        given.append(of)
        return evidence[len(given) - 1]

    monkeypatch.setattr(calibration, "reconstruct", invert)
    monkeypatch.setattr(LearnedPrior, "gather_evidence", gather)
    observed = calibration.observe(prior, shown)
    assert [spec.name for _, _, spec in given] == ["skimage", "paper", "opencv"]
    for (image, descriptor, spec), expected, whole in zip(given, images, wholes, strict=True):
        assert torch.equal(image, expected)
        assert torch.equal(descriptor, hog(whole, spec))
    assert observed.log_odds.tolist() == [-1, 0, 1]
    assert observed.right.tolist() == right
    assert torch.equal(observed.agreement, torch.cat([each.agreement.flatten() for each in evidence]).double())
    bright, truly = (torch.cat([smooth_regions(image) for image in each]) > 0 for each in (images, wholes))
    same, other, side = bright == truly
    assert torch.equal(observed.regions_right, torch.cat([same, ~other, side]).flatten().double())
    assert (float(same.double().mean()), float(other.double().mean())) == (1, 0)
    assert 0.1 < float(side.double().mean()) < 0.9
    weights = torch.tensor([0.5**0.5, 0.5**0.5, 1.0], dtype=torch.float64)
    assert_close(observed.weights, weights)
    assert_close(observed.region_weights, (weights / 512).repeat_interleave(512))


def observations(log_odds: Tensor, right: float, agreement: Tensor | None = None) -> Observations:
    """Of pre-images, the first of which are right; a region each."""
    count = len(log_odds)
    is_right = (torch.arange(count) < right * count).double()
    agreement = torch.zeros(count) if agreement is None else agreement
    weights = torch.ones(count, dtype=torch.float64)
    return Observations(log_odds.double(), is_right, weights, agreement.double(), is_right, weights)


def test_a_calibration_finds_the_numbers_that_its_observations_are_as_likely_as() -> None:
    generator = torch.Generator().manual_seed(0)
    log_odds, agreement = (scale * torch.randn(1_000, generator=generator).double() for scale in (4.0, 1.5))
    expected = Calibration(0.6, 0.7, 0.4, 0.9)
    likely = expected.polarity(log_odds)
    regions_likely = torch.sigmoid(expected.constant + expected.agreement_weight * agreement)
    right = torch.cat([torch.ones_like(log_odds), torch.zeros_like(log_odds)])  # each is, and is not, as often
    weights, region_weights = (torch.cat([chance, 1 - chance]) for chance in (likely, regions_likely))
    observed = Observations(log_odds.repeat(2), right, weights, agreement.repeat(2), right, region_weights)
    assert calibration.fit(observed) == pytest.approx(expected, abs=0.01)


@pytest.mark.slow
def test_a_prior_that_was_calibrated_says_so_in_its_file(tmp_path: Path) -> None:
    prior = calibration.calibrate(tiny_models.prior(PAPER), {k: image[:40, :40] for k, image in patches(8).items()})
    assert len(prior.learning.calibration) == len(Calibration._fields)
    prior.save(tmp_path / "p.npz")
    assert LearnedPrior.load(tmp_path / "p.npz").calibration == prior.calibration
