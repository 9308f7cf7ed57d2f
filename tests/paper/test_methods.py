"""The registry: names, rows, published figures, and each method on a small image."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog import hog
from nablahog.invert.prior.choice import default_prior_file
from nablahog.paper.learned import SPEC, load, shipped_files, tiles
from nablahog.paper.methods import METHODS, ReconstructionMethod, Table1Settings, choose
from nablahog.paper.names import (
    DIALECTS,
    LEARNED_DIALECTS,
    LIBRARIES,
    POSE_PUBLISHED,
    PRIORS,
    PUBLISHED,
    TABLE1,
    TABLE2,
)
from nablahog.paper.pose_methods import POSE_METHODS

from .common import image, photographs, write_prior

FAST = Table1Settings(max_evaluations=8)
SOME = ("bovw", "hoggles", "cnn-hog", "cnn-hogb", "paper-uoctti-single", "uoctti-multi-scale", "uoctti-learned")
SOME += ("dalal-multi-scale-more", "opencv")


def test_rows() -> None:
    assert METHODS["dalal-single"].rows == ("dalal-single",)
    levels = tuple(f"dalal-multi-scale@1/{s}" for s in (64, 16, 4, 1))
    assert METHODS["dalal-multi-scale"].rows == ("dalal-multi-scale", *levels)
    rows = [row for method in METHODS.values() for row in method.rows]
    assert len(rows) == len(set(rows))


def test_published_figures() -> None:
    """Two rows, and the sums of the columns of the paper's tables."""
    assert PUBLISHED["hoggles"] == (0.409, 1.497, 0.271)
    rows = [means for name, means in PUBLISHED.items() if not name.startswith("paper-") and not name.endswith("@1/1")]
    assert len(rows) == 14
    np.testing.assert_allclose(np.sum(rows, axis=0), (4.098, 20.816, 4.007), atol=1e-9)
    assert POSE_PUBLISHED["exemplar"] == {4: 47.33, 8: 35.39, 16: 20.16, 24: 15.23}
    assert POSE_PUBLISHED["paper"] == {4: 58.85, 8: 40.74, 16: 22.22, 24: 16.87}
    assert PUBLISHED["paper-dalal-multi-scale-more@1/16"] == (0.191, 1.502, 0.291)
    for name in ("dalal-multi-scale", "dalal-multi-scale-more"):
        assert PUBLISHED[name] == PUBLISHED[f"{name}@1/1"]
    assert set(PUBLISHED) <= {row for method in METHODS.values() for row in method.rows}


@pytest.mark.slow
@pytest.mark.parametrize("name", SOME)
def test_a_method(name: str, tmp_path: Path, learned_files: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.paper.baselines.cnn_hog.RATE_ITERATIONS", 10)
    method = METHODS[name]
    original = photographs(1, 40 if name == "bovw" else 32).images["0.png"]  # two windows of words, at least
    sent: ReconstructionMethod = pickle.loads(pickle.dumps(method))  # as it reaches the workers
    learned = {kind: Path(path) for kind, path in learned_files.items()}
    learned |= {"prior": write_prior(tmp_path / "prior.npz", SPEC), **shipped_files()}
    result = sent.run(original[None, None], replace(FAST, learned=learned))
    assert len(result) == len(method.rows)
    for one in result:
        assert one.image.shape == original.shape
        assert 0 <= one.image.min() <= one.image.max() <= 1
        assert one.distance > 0 or name == "bovw"  # one of few words in two places may well be right
    if method.multiscale:
        assert torch.equal(result[0].image, result[-1].image)
        assert result[0].distance == result[-1].distance
    if method.spec is not None:
        d, x = (hog(each[None, None], method.spec) for each in (original, result[0].image))
        assert result[0].distance == pytest.approx(float((x - d).norm() / d.norm()), rel=1e-3)


def test_the_prior_decides(tmp_path: Path) -> None:
    method, path = METHODS["uoctti-learned"], tmp_path / "p.npz"
    assert method.spec is not None
    made = []
    for value in (0.1, 0.1, -0.1):
        write_prior(path, method.spec, value=value)  # a file that changed is read again
        made.append(method.run(image()[None, None], replace(FAST, learned={"prior": path}))[0].image)
    assert torch.equal(made[0], made[1])
    assert not torch.equal(made[0], made[2])
    assert load("prior", path) is load("prior", path)
    with pytest.raises(ValueError, match="`nablahog learn prior`"):
        method.run(image()[None, None], FAST)
    with pytest.raises(FileNotFoundError, match="no such file"):
        load("prior", tmp_path / "no")


def test_what_can_be_asked_for_is_what_there_is() -> None:
    assert tuple(METHODS) == TABLE1
    assert tuple(POSE_METHODS) == TABLE2
    of_libraries = tuple(name for name, method in METHODS.items() if method.group == LIBRARIES)
    assert of_libraries == (*DIALECTS, *LEARNED_DIALECTS)
    assert tuple(f"{name}-learned" for name, spec in DIALECTS.items() if default_prior_file(spec)) == LEARNED_DIALECTS


def test_choosing() -> None:
    every, learned = [method for method in METHODS.values() if not method.asked], METHODS["uoctti-learned"]
    lacking = [method for method in every if {*method.needs} & {*PRIORS}]
    assert choose(None, list(PRIORS)) == (every, [])
    assert choose(None, []) == ([method for method in every if method not in lacking], lacking)
    unsigned = ["dalal-learned", "dalal-multi-scale-more-learned"]
    assert [m.name for m in lacking if m not in choose(None, [], PRIORS)[1]] == ["uoctti-learned", *unsigned]
    assert [m.name for m in lacking if m not in choose(None, [], ["prior"])[1]] == ["uoctti-learned"]
    assert choose(unsigned, [], PRIORS) == ([METHODS[name] for name in unsigned], [])
    two = ["dalal-single", "uoctti-single"]
    assert choose(two, []) == ([METHODS[name] for name in reversed(two)], [])
    assert choose(["uoctti-learned"], ["prior"]) == ([learned], [])
    assert choose(list(DIALECTS), []) == ([METHODS[name] for name in DIALECTS], [])
    assert all(METHODS[name].asked for name in DIALECTS)
    with pytest.raises(ValueError, match="uoctti-learned needs a file of prior"):
        choose([*two, "uoctti-learned"], [])
    with pytest.raises(ValueError, match="uses a file of prior; these do: uoctti-learned"):
        choose(two, ["prior"])


def test_tiles_overlap_by_half_in_images_and_in_these_at_half_their_size() -> None:
    down, across = ((torch.arange(n) + 0.5) / n / 2 for n in (23, 31))
    image = down[:, None] + across
    squares = tiles({"a": image}, 8)
    assert {square.shape for square in squares.values()} == {(8, 8)}
    assert len(squares) == 4 * 6 + 1 * 2
    assert torch.equal(squares["a, 1/1, 12, 20"], image[12:20, 20:28])
    assert float(squares["a, 1/2, 0, 4"].mean()) == pytest.approx((4 / 11 + 8 / 15) / 2, abs=5e-3)


def test_the_seed_decides() -> None:
    run = METHODS["dalal-single"].run
    made = [run(image()[None, None], Table1Settings(seed, max_evaluations=4))[0].image for seed in (0, 0, 1)]
    assert torch.equal(made[0], made[1])
    assert not torch.equal(made[0], made[2])


def test_images_without_a_64th() -> None:
    with pytest.raises(ValueError, match="1/64"):
        METHODS["uoctti-multi-scale"].run(image()[None, None, :30, :28], FAST)
