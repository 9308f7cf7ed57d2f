"""What a prior for unsigned descriptors is trained with, and how sure it then says that it is."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d
from torch.testing import assert_close

from nablahog import presets
from nablahog.hog import HOGSpec
from nablahog.invert import training_windows, unsigned_training
from nablahog.invert.prior_network import Architecture
from nablahog.invert.training_windows import HELD_OUT
from nablahog.invert.unsigned_network import UnsignedNetwork
from nablahog.invert.unsigned_training import DIALECTS, UnsignedTraining

from .photographs import photograph

SPEC = presets.paper(8)


def _patches(count: int) -> list[Tensor]:
    """Of one photograph, (64, 64) each."""
    whole = photograph(512)[0, 0]
    places = torch.randint(whole.shape[0] - 64, (count, 2), generator=torch.Generator().manual_seed(0))
    return [whole[top : top + 64, left : left + 64] for top, left in places.tolist()]


def _network(scale: float = 1.0) -> UnsignedNetwork:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = UnsignedNetwork(SPEC, Architecture((8, 8, 8), (0, 0, 0))).eval()
    network.polarity.out.weight.data *= scale
    return network


def _training(images: list[Tensor]) -> UnsignedTraining:
    return UnsignedTraining(images, SPEC, seed=0)


def test_images_held_out_are_not_trained_with(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_windows, "BATCH", 4)
    images = [image * torch.nan if k % HELD_OUT == HELD_OUT // 2 else image for k, image in enumerate(_patches(50))]
    training = _training(images)
    assert len(training.held_out) == 2
    assert len(training.images) == 48
    assert training.crops == 48
    for batch in training.batches(0):
        assert torch.isfinite(batch.votes).all()
        assert torch.isfinite(batch.images).all()


@pytest.mark.parametrize("specs", DIALECTS[-2:], ids=lambda specs: " ".join(spec.name for spec in specs))
def test_votes_of_all_dialects_come_with_the_images(monkeypatch: pytest.MonkeyPatch, specs: list[HOGSpec]) -> None:
    """There are more votes where the image has edges."""
    monkeypatch.setattr(unsigned_training, "DIALECTS", [specs])
    batch = next(_training(_patches(40)).batches(0))
    rows, cols = batch.votes.shape[2:]
    assert batch.images.shape == (32, 1, 2 * rows, 2 * cols)
    contrast = avg_pool2d(batch.images.square(), 2) - avg_pool2d(batch.images, 2).square()
    for part, spec in zip(torch.arange(32).chunk(len(specs)), specs, strict=True):
        votes, edges = (x[part].log1p().flatten() for x in (batch.votes.sum(dim=1, keepdim=True), contrast))
        if spec.name != "maskfeat":  # whose cells have all the same contrast
            assert float(torch.corrcoef(torch.stack([votes, edges]))[0, 1]) > 0.3


def test_confidence_is_scaled_to_the_images_held_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Right of three in four, the log-odds are to be log 3."""
    training, network = _training(_patches(8 * HELD_OUT)), _network()
    odds = iter([2.0, 2.0, -2.0, 2.0] * 2)
    monkeypatch.setattr(training, "_odds", lambda network, image: torch.tensor([next(odds)]))
    training.calibrate(network)
    assert_close(network.polarity.out.weight, _network(math.log(3) / 2).polarity.out.weight, rtol=0.02, atol=0)


def test_confidence_stays_where_few_images_are_held_out() -> None:
    network = _network()
    _training(_patches(4 * HELD_OUT)).calibrate(network)
    assert torch.equal(network.polarity.out.weight, _network().polarity.out.weight)
