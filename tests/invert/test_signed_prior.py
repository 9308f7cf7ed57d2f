"""A prior for signed descriptors: one network for all dialects, to which left is as right."""

from __future__ import annotations

import dataclasses
import random

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.hog.descriptor import histograms
from nablahog.invert import signed_training
from nablahog.invert.cell_votes import signed_cells
from nablahog.invert.histograms import searchable
from nablahog.invert.signed_network import mirrored_votes
from nablahog.invert.signed_training import DIALECTS, SignedTraining

from ..io import tiny_models
from .photographs import photograph

UOCTTI = presets.uoctti(8)
SIGNED = {
    "uoctti": UOCTTI,
    "hard votes": presets.vlfeat(),
    "bins between the axes": dataclasses.replace(UOCTTI, bin_offset=0.5),
    "twelve bins, other sense": dataclasses.replace(UOCTTI, bins=12, counterclockwise=True),
    "dpm": presets.dpm(),
    "dlib": presets.dlib(),
    "piotr": presets.piotr(),
    "cnn_hog": presets.cnn_hog(),
    "opencv, signed": presets.opencv((128, 128), nbins=18, signed=True),
}

every_dialect = pytest.mark.parametrize("spec", SIGNED.values(), ids=SIGNED)


def _cells(image: Tensor, spec: HOGSpec) -> Tensor:
    spec = searchable(spec)
    return signed_cells(histograms(image, spec), spec, (image.shape[2], image.shape[3]))


@every_dialect
def test_all_dialects_look_alike(spec: HOGSpec) -> None:
    image = photograph(128)
    ours, theirs = (_cells(image, each).log1p().flatten() for each in (UOCTTI, spec))
    assert ours.shape == theirs.shape
    assert float(torch.corrcoef(torch.stack([ours, theirs]))[0, 1]) > 0.75


def test_votes_on_a_centre_are_not_shared() -> None:
    image = photograph(128)
    assert torch.equal(_cells(image, UOCTTI), histograms(image, UOCTTI))


def test_mirrored_votes() -> None:
    image = photograph(128)
    assert_close(_cells(image.flip(3), UOCTTI), mirrored_votes(_cells(image, UOCTTI)), atol=0.1, rtol=1e-3)


@every_dialect
def test_expected(spec: HOGSpec) -> None:
    """Of a batch that of each."""
    images, prior = torch.cat([photograph(128, name) for name in ("camera", "coins")]), tiny_models.prior()
    descriptors = hog(images, spec)
    together = prior.expected(descriptors, spec, (128, 128))
    alone = torch.cat([prior.expected(each[None], spec, (128, 128)) for each in descriptors])
    assert_close(together, alone, atol=1e-3, rtol=0)
    assert_close(together.mean(dim=(1, 2, 3)), torch.full((2,), 0.5), atol=1e-4, rtol=0)


@pytest.mark.parametrize("specs", DIALECTS[2:], ids=lambda specs: " ".join(spec.name for spec in specs))
def test_histograms_of_all_dialects_come_with_the_windows(
    monkeypatch: pytest.MonkeyPatch, specs: list[HOGSpec]
) -> None:
    """What they integrate to resembles the windows."""
    monkeypatch.setattr(signed_training, "DIALECTS", [specs])
    image = photograph(128)[0, 0]
    batch = next(SignedTraining([image] * 8, UOCTTI, seed=0).batches(0))
    assert batch.integral.shape == batch.windows.shape
    each = [torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1] for a, b in zip(*batch[1:], strict=True)]
    assert min(map(float, each)) > 0.6


def test_windows_are_not_enlarged() -> None:
    """But those of photographs that are too small."""
    training, rng = SignedTraining([photograph(64)[0, 0]], UOCTTI, seed=0), random.Random(0)
    assert all(1 <= training._scale(3.0, rng) <= 3 for _ in range(50))
    assert training._scale(0.5, rng) == 0.5
    assert training._window(torch.rand(300, 40), (4, 6), rng).shape == (1, 1, 32, 48)
