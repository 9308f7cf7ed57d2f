"""Files of learned priors, those of the package, and arguments that do not fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from nablahog import hog, reconstruct
from nablahog.hog import FourBlockNorm
from nablahog.invert import default_prior, reconstruct_samples
from nablahog.invert.prior.choice import PRIOR_FOLDER
from nablahog.invert.prior.confidence import check_calibration

from ..io import tiny_models
from ..io.archives import check_refused
from .photographs import photograph
from .prior_dialects import FEW, PAPER, UOCTTI

UNDIRECTED = FourBlockNorm(parts=("undirected", "texture"), texture="dpm")  # of directed histograms


def test_what_does_not_fit() -> None:
    prior, image = tiny_models.prior(PAPER), photograph(64)
    descriptor, of_signed = hog(image, PAPER), hog(image, UOCTTI)
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: prior.expected(of_signed, UOCTTI, (64, 64)), "is for unsigned descriptors, .* uoctti descriptor is"),
        (lambda: reconstruct(descriptor, PAPER, prior=prior, expected=image), "and a prior contradict each other"),
        (lambda: prior.polarity_confidence(photograph(32), descriptor, PAPER), "must have shape"),
        *(
            (lambda several=several: reconstruct(of_signed, UOCTTI, prior=several, search=FEW), "expected one prior")
            for several in ([], [default_prior("paper")], [default_prior("uoctti")] * 2)
        ),
        (lambda: default_prior(replace(UOCTTI, normalizer=UNDIRECTED)), "no prior for .* comes with the package"),
        (lambda: reconstruct_samples(descriptor, PAPER, count=1), "count must be an integer"),
        (lambda: reconstruct_samples(of_signed, UOCTTI), "need a prior for unsigned descriptors"),
        (lambda: prior.expected(descriptor, PAPER, (64, 64), torch.zeros(2, 9, 8, 8)), "must"),  # of another batch
        (lambda: prior.polarity_confidence(image.repeat(2, 1, 1, 1), descriptor, PAPER), "must"),
    ]
    for call, says in wrong:
        with pytest.raises(ValueError, match=says):
            call()
    unfit: list[Callable[[], object]] = [
        *(lambda prior=prior: reconstruct(descriptor, PAPER, prior=prior, search=FEW) for prior in ("best", [None])),
        lambda: reconstruct_samples(descriptor, PAPER, prior=None),
        lambda: prior.expected(descriptor.to_sparse(), PAPER, (64, 64)),
        lambda: prior.expected(descriptor, PAPER, 64),  # type: ignore[arg-type]
        lambda: prior.samples(descriptor, PAPER, (64, 64), 2.5),  # type: ignore[arg-type]
        lambda: prior.samples(descriptor, PAPER, (64, 64), 2, seed="a"),  # type: ignore[arg-type]
        lambda: reconstruct(descriptor, PAPER, search="fast"),  # type: ignore[arg-type]
    ]
    for call in unfit:
        with pytest.raises((TypeError, ValueError), match="must"):
            call()


COUNT = len(tiny_models.prior().weights)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"weights": np.full(COUNT, np.nan, np.float16)}, "the weights must lie within ±65504, got NaN, Inf or more"),
        ({"weights": np.zeros(COUNT - 1, np.float16)}, rf"shape \({COUNT},\), got float16 of \({COUNT - 1},\)"),
        ({"weights": np.zeros(COUNT, np.float32)}, "must be float16 of shape .* got float32"),
        ({"spec": np.array(PAPER.to_json())}, "the weights must be"),
        ({"widths": np.array([8, 8, 0])}, "widths must be integers in 1…1024"),
        (
            {"widths": np.array([8] * 4), "blocks": np.array([1, 0, 0, 0])},
            "a prior for signed descriptors has 3 widths",
        ),
        ({"blocks": np.array([1, 0, 0, 0])}, "as many widths as blocks"),
    ],
)
def test_files_that_contradict_themselves_are_refused(tmp_path: Path, changed: dict[str, Any], says: str) -> None:
    check_refused(tiny_models.prior(), tmp_path / "p.npz", changed, says)


def test_calibrations_other_than_four_numbers_in_range_are_refused() -> None:
    learning, rest = tiny_models.prior(PAPER).learning, (1.0, 0.0, 1.0)
    wrong: list[Any] = [
        (1.0,),
        (1.0, 1.1, 0.0, 1.0),
        (1.0, 1.0, np.nan, 1.0),
        (-1.0, *rest),
        ("1", *rest),
        (True, *rest),
    ]
    for numbers in wrong:
        with pytest.raises(ValueError, match="calibration must be"):
            replace(tiny_models.prior(PAPER), learning=replace(learning, calibration=numbers))


def test_a_package_without_its_priors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.prior.choice.PRIOR_FOLDER", tmp_path)
    with pytest.raises(FileNotFoundError, match=r"no unsigned\.npz, the prior for unsigned descriptors"):
        reconstruct(hog(photograph(64), PAPER), PAPER, search=FEW)


@pytest.mark.parametrize("spec", ["paper", "uoctti"])
def test_the_readme_says_where_the_packages_priors_are_from(spec: str) -> None:
    prior, readme = default_prior(spec), (PRIOR_FOLDER / "README.md").read_text(encoding="utf-8")
    assert default_prior(spec) is prior
    for text in (prior.learning.sha256, f"{len(prior.learning.images):,} ", f"--epochs {prior.learning.epochs}"):
        assert text in readme
    assert f"seed {prior.learning.seed}" in readme
    assert prior.learning.start in readme
    assert sum(file.stat().st_size for file in PRIOR_FOLDER.glob("*.npz")) <= 16 * 10**6


def test_calibrations_at_their_limits() -> None:
    for numbers in ((), (0.0, 0.0, -1.0, -1.0), (9.0, 1.0, 0.0, 0.0)):
        check_calibration(numbers)
    for numbers in ((-0.1, 0.5, 0.0, 0.0), (1.0, -0.1, 0.0, 0.0), (1.0, 1.1, 0.0, 0.0), (1.0, 1.0, 0.0)):
        with pytest.raises(ValueError, match="the calibration must be 4 finite numbers"):
            check_calibration(numbers)
