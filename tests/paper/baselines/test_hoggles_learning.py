"""HOGgles: learning lowers the objective, and does not depend on what it should not."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from nablahog import hog
from nablahog.paper.baselines.hoggles import PairedDictionary, hog_windows, unit
from nablahog.paper.baselines.hoggles_learning import learn_hoggles
from nablahog.paper.baselines.lasso import lasso

from ...invert.photographs import photograph
from .hoggles_pairs import NAMES, SPEC, fast, images, learned


def test_learning_lowers_the_objective_of_other_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    windows_alone = learn_hoggles(images(), SPEC, atoms=40, fast=True)
    others = unit(hog_windows(hog(photograph(64, "coffee"), SPEC)).flatten(3).flatten(0, 2))

    def objective(pair: PairedDictionary) -> float:
        atoms = pair.hog.flatten(1)
        atoms = atoms / atoms.norm(dim=1, keepdim=True)
        codes = lasso(atoms, others, 0.02)
        return float((others - codes @ atoms).square().sum() / 2 + 0.02 * codes.sum()) / len(others)

    assert objective(learned()) < 0.95 * objective(windows_alone)
    monkeypatch.setattr("nablahog.paper.baselines.hoggles_learning.REPORTED", 5)
    of_batches = learn_hoggles(images(), SPEC, atoms=40, iterations=12).learning.objective
    assert len(of_batches) == 3
    assert of_batches[2] < of_batches[1] < of_batches[0]


def test_fast_atoms_are_windows_with_their_patches() -> None:
    pair = fast()
    patches, windows = [], []
    for image in images().values():
        patches.append(image.unfold(0, 28, 4).unfold(1, 28, 4).reshape(-1, 28 * 28))
        inner = hog(image[None, None], SPEC)[:, 1:-1, 1:-1]
        windows.append(hog_windows(inner).flatten(3).flatten(0, 2))
    pool = torch.cat([unit(torch.cat(patches)), unit(torch.cat(windows))], dim=1)
    for atom in torch.cat([pair.gray.flatten(1), pair.hog.flatten(1)], dim=1):
        assert (pool - atom).abs().amax(dim=1).min() < 1e-5
    assert pair.learning.iterations == 0
    assert pair.learning.objective == ()
    assert pair.learning.windows == len(pool)


def test_the_seed_decides() -> None:
    given = images()
    first = learned()
    torch.rand(1)  # the global generator does not
    second = learn_hoggles(dict(reversed(given.items())), SPEC, atoms=40, iterations=8)
    assert torch.equal(first.gray, second.gray)
    assert torch.equal(first.hog, second.hog)
    assert first.learning == second.learning
    assert first.learning.images == tuple(sorted(NAMES))
    for changed in ({"seed": 1}, {"windows": 200}):
        assert not torch.equal(learn_hoggles(given, SPEC, atoms=40, iterations=8, **changed).hog, first.hog)
    other = learn_hoggles({**given, "clock": given["coins"]}, SPEC, atoms=40, fast=True)
    assert other.learning.sha256 != first.learning.sha256


def test_threads_make_no_difference_but_rounding(two_threads: None) -> None:
    result = learn_hoggles(images(), SPEC, atoms=40, iterations=2)
    image = result.reconstruct(hog(photograph(64), SPEC), SPEC).image
    torch.set_num_threads(1)
    alone = learn_hoggles(images(), SPEC, atoms=40, iterations=2)
    torch.testing.assert_close(result.hog, alone.hog, atol=1e-3, rtol=0)
    torch.testing.assert_close(image, alone.reconstruct(hog(photograph(64), SPEC), SPEC).image, atol=1e-2, rtol=0)


def test_progress() -> None:
    seen: list[tuple[int, int]] = []
    learn_hoggles(images(), SPEC, atoms=10, iterations=2, progress=lambda done, total, what: seen.append((done, total)))
    assert seen == [(0, 2), (0, 2), (1, 2), (2, 2)]


def test_images_of_several_sizes() -> None:
    camera = photograph(64)[0, 0]
    images = {"a": camera[:28, :28], "b": camera[:39, :50], "c": camera}
    pair = learn_hoggles(images, SPEC, atoms=20, fast=True)
    assert pair.learning.windows == 1 + 3 * 6 + 10 * 10


def test_what_cannot_be_learned_from() -> None:
    camera = photograph(64)[0, 0]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:27]}}, "a: expected at least 28x28 pixels, got 27x64"),
        ({"images": {"a": camera[:0]}}, "a: expected at least 28x28 pixels, got 0x64"),
        ({"images": {"a": camera * 255}}, "a: expected an image"),
        ({"images": {"a": camera.double()}}, "a: expected an image"),
        ({"images": {"a": camera * torch.nan}}, "a: expected an image"),
        ({"images": {"a": camera[None]}}, "a: expected an image"),
        ({"images": {"a": camera[:28, :28]}}, "at least 5 windows of 5x5 cells, got 1, 1 of them not flat"),
        ({"images": {"a": torch.full((64, 64), 0.5)}}, "at least 5 windows of 5x5 cells, got 100, 0 of them not flat"),
        ({"atoms": 0}, "atoms must be at least 1, got 0"),
        ({"iterations": 0}, "iterations must be at least 1, got 0"),
        ({"windows": 0}, "windows must be at least 1, got 0"),
        ({"sparsity": 0.0}, "sparsity must be a finite number above 0, got 0"),
        ({"sparsity": float("nan")}, "sparsity must be a finite number above 0, got nan"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            learn_hoggles(**{"images": {"a": camera}, "spec": SPEC, "atoms": 5, **changed})
