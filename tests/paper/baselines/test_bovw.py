"""BoVW: words that are learned and arranged."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.metrics import cross_correlation
from nablahog.paper.baselines.bovw import BoVW
from nablahog.paper.baselines.bovw_learning import ROUNDS, learn_bovw
from nablahog.paper.baselines.dense_sift import dense_sift

from ...interruption import Interruption
from ...invert.photographs import photograph
from ...io import tiny_models
from ...io.archives import check_refused

NAMES = ("brick", "camera", "clock", "coins")
CELL, PATCH, WORDS = 4, 20, 40


# --- learning


def _images() -> dict[str, Tensor]:
    images = {name: photograph(64, name)[0, 0] for name in NAMES}
    return images | {"flat": torch.full((64, 64), 0.25)}


def _learned(images: dict[str, Tensor] | None = None, **options: Any) -> BoVW:
    return learn_bovw(images or _images(), **{"words": WORDS, "cell": CELL, "patch": PATCH, **options})


@pytest.fixture(scope="module")
def learned() -> BoVW:
    """Says what is done: description, each round of k-means, patches."""
    steps: list[tuple[int, int]] = []
    model = _learned(progress=lambda done, total, what: steps.append((done, total)))
    assert steps == [(done, ROUNDS + 2) for done in range(ROUNDS + 3)]
    return model


def _stack() -> Tensor:
    return torch.stack([image for _, image in sorted(_images().items())]).unsqueeze(1)


def test_the_database_is_the_images_words(learned: BoVW) -> None:
    images = _stack()
    assert torch.equal(learned.database.long(), learned.words(torch.cat([images, images.flip(3)])))
    assert learned.database.shape == (10, 13, 13)
    assert learned.image_size == (64, 64)
    assert learned.learning.images == ("brick", "camera", "clock", "coins", "flat")


@pytest.mark.slow
def test_a_patch_is_the_mean_of_its_windows(learned: BoVW) -> None:
    images = _stack()
    both = torch.nn.functional.pad(torch.cat([images, images.flip(3)]), (2, 2, 2, 2), mode="replicate")[:, 0]
    for word in (0, 1, len(learned.vocabulary) - 1):
        seen = [
            both[k, row * CELL : row * CELL + PATCH, col * CELL : col * CELL + PATCH]
            for k, row, col in (learned.database == word).nonzero().tolist()
        ]
        torch.testing.assert_close(learned.patches[word], torch.stack(seen).mean(0), atol=1e-5, rtol=0)


def test_words_are_means_of_their_windows(learned: BoVW) -> None:
    """Nearly: the rounds of k-means have an end."""
    images = _stack()
    windows = dense_sift(torch.cat([images, images.flip(3)]), CELL)
    assert learned.learning.windows == int(windows.any(dim=3).sum())  # all with contrast
    means = torch.stack([windows[learned.database == word].mean(0) for word in range(len(learned.vocabulary))])
    assert (means - learned.vocabulary).norm(dim=1).median() < 0.05


def test_flat_windows_are_a_word(learned: BoVW) -> None:
    histogram = learned.histogram(torch.full((1, 1, 64, 64), 0.9))
    assert histogram[0].tolist() == [169] + [0] * (len(learned.vocabulary) - 1)
    result = learned.reconstruct(histogram)
    assert float(result.distance) == 0
    assert float(result.image.std()) < 0.05


def test_the_seed_decides(learned: BoVW) -> None:
    torch.rand(1)  # the global generators do not
    np.random.rand(1)  # noqa: NPY002
    again = _learned(dict(reversed(_images().items())))
    for name in ("vocabulary", "patches", "database"):
        assert torch.equal(getattr(again, name), getattr(learned, name))
    assert again.learning == learned.learning
    assert not torch.equal(_learned(seed=1).patches[:20], learned.patches[:20])
    changed = _images() | {"brick": photograph(64, "coins")[0, 0]}
    assert _learned(changed).learning.sha256 != learned.learning.sha256


def test_an_interrupted_learning_is_resumed(learned: BoVW, tmp_path: Path) -> None:
    checkpoint = tmp_path / "checkpoint"
    with pytest.raises(KeyboardInterrupt):
        _learned(checkpoint=checkpoint, progress=Interruption(at=8))
    rest = Interruption()
    resumed = _learned(checkpoint=checkpoint, progress=rest)
    assert rest.steps == [0, *range(8, ROUNDS + 3)]
    for name in ("vocabulary", "patches", "database"):
        assert torch.equal(getattr(resumed, name), getattr(learned, name))
    changed = {"images": _images() | {"extra": _images()["camera"]}, "words": WORDS - 1, "cell": 5, "seed": 1}
    for name, value in changed.items():
        with pytest.raises(ValueError, match=rf"another training \(with other {name}\)"):
            _learned(checkpoint=checkpoint, **{name: value})
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(ValueError, match="damaged"):
        _learned(checkpoint=checkpoint)


def test_words_that_nothing_is_are_left_out() -> None:
    edge = torch.cat([torch.zeros(20, 10), torch.ones(20, 10)], dim=1)
    model = _learned({"a": edge, "b": edge * 0.5}, words=9)
    assert 2 <= len(model.vocabulary) < 9
    assert len(model.database.unique()) == len(model.vocabulary)


def test_what_cannot_be_learned_from() -> None:
    camera = photograph(64)[0, 0]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {"a": camera[:18, :16]}}, r"at least two windows of 16x16 pixels, 4 apart, got 18x16"),
        ({"images": {"a": camera, "b": camera[1:]}}, "of one size, but a has 64x64 pixels, b 63x64"),
        ({"images": {"a": camera * 255}}, "a must have gray values in 0…1"),
        ({"images": {"a": camera[:20, :20]}}, r"at least 39 windows with contrast to find 40 words, got 8"),
        ({"words": 1}, "words must be 2 … 32767, got 1"),
        ({"patch": 17}, "a patch must be 16 pixels wide, or an even number more, got 17"),
    ]
    for changed, message in wrong:
        options = {"images": {"a": camera}, "words": WORDS, "cell": CELL, "patch": PATCH, **changed}
        with pytest.raises(ValueError, match=message):
            learn_bovw(**options)
    assert len(learn_bovw({"a": camera[:20, :20]}, words=9, cell=CELL, patch=PATCH).vocabulary) == 8  # none is flat


# --- inversion


def test_the_histogram_counts(learned: BoVW) -> None:
    images = _stack()
    words, histogram = learned.words(images), learned.histogram(images)
    assert histogram.shape == (5, len(learned.vocabulary))
    for some, counts in zip(words, histogram, strict=True):
        assert counts.tolist() == torch.bincount(some.flatten(), minlength=len(counts)).tolist()


def test_words_in_place_look_like_the_image(learned: BoVW) -> None:
    images = _stack()[:4]
    pictures = learned.render(learned.words(images))
    assert pictures.shape == images.shape
    likeness = [cross_correlation(a[0], b[0]) for a, b in zip(pictures, images, strict=True)]
    assert np.mean(likeness) > 0.6


def test_inversion_of_what_was_learned(learned: BoVW) -> None:
    """Its words come back to where the database has them, more or less, and never with the wrong polarity."""
    images = _stack()[:4]
    histogram = learned.histogram(images)
    result = learned.reconstruct(histogram)
    assert result.image.shape == images.shape
    assert result.image.dtype == torch.float32
    assert 0 <= result.image.min() <= result.image.max() <= 1
    likeness = [cross_correlation(a[0], b[0]) for a, b in zip(result.image, images, strict=True)]
    assert np.mean(likeness) > 0.3
    own = learned.histogram(result.image)
    torch.testing.assert_close(result.distance, (own - histogram).norm(dim=1) / histogram.norm(dim=1))


def test_the_history_is_that_of_the_cost(learned: BoVW) -> None:
    began = time.perf_counter()
    result = learned.reconstruct(learned.histogram(_stack()))
    assert 0 < result.seconds < time.perf_counter() - began
    assert result.history.shape == (int(result.evaluations.max()) + 1, 5)
    assert (result.history.diff(dim=0) <= 0).all()
    assert (result.history[-1, :4] < result.history[0, :4]).all()
    assert result.stop_reason == ["no swap of two words lowers the cost"] * 5


def test_a_batch_is_each_of_it(learned: BoVW) -> None:
    histogram = learned.histogram(_stack())
    together = learned.reconstruct(histogram, seed=3)
    for k in range(5):
        alone = learned.reconstruct(histogram[k : k + 1], seed=3)
        torch.testing.assert_close(alone.image[0], together.image[k])
        assert alone.evaluations[0] == together.evaluations[k]


def test_images_of_another_size(learned: BoVW) -> None:
    with pytest.raises(ValueError, match=r"images of 64x64 pixels \(height x width\), got 64x32$"):
        learned.histogram(_stack()[..., :32])


# --- files


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"vocabulary": np.full((3, 128), np.nan, np.float32)}, r"the vocabulary must lie in 0…1, got NaN"),
    ({"vocabulary": np.zeros((0, 128), np.float32)}, r"the vocabulary must be float32"),
    ({"patches": np.full((3, 16, 16), 1.5, np.float32)}, "the patches must lie in 0…1"),
    ({"patches": np.zeros((3, 14, 14), np.float32)}, "a patch must be 16 pixels wide"),
    ({"database": np.full((2, 1, 2), 3, np.int16)}, "the database must lie in 0…2"),
    ({"database": np.zeros((2, 1, 2), np.int16)}, "each word of the vocabulary must occur"),
    ({"image_size": np.array([16, 24])}, r"the database must be int16 of shape \(2, 1, 3"),
    ({"cell": np.array(0)}, "a cell must be at least 1 pixel wide, got 0"),
]


def test_wrong_contents(tmp_path: Path) -> None:
    for changed, message in WRONG:
        check_refused(tiny_models.bovw(), tmp_path / "w.npz", changed, message)
