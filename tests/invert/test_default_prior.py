"""The priors that come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from nablahog import hog, metrics, presets, reconstruct, reconstruct_multiscale
from nablahog.hog import HOGSpec
from nablahog.invert import Search, default_prior, scale_descriptors
from nablahog.invert.prior_choice import FOLDER

from .photographs import photograph

FEW = Search(max_evaluations=4)


SPECS = [presets.paper(8), presets.opencv(), presets.aubry(8), presets.uoctti(8), presets.dpm()]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_by_default(spec: HOGSpec) -> None:
    descriptor = hog(photograph(128), spec)
    own = default_prior(spec)
    several = [own] if own.signed else [own, default_prior("uoctti")]
    default, both, alone, none = (
        reconstruct(descriptor, spec, prior=prior, search=FEW).image for prior in ("default", several, own, None)
    )
    assert torch.equal(default, both)
    assert torch.equal(default, alone) == own.signed
    assert not torch.equal(default, none)


def test_by_the_name_of_a_preset() -> None:
    image = photograph(128)
    result = reconstruct(hog(image, "skimage"), "skimage", prior="default", search=FEW)
    assert result.polarity_confidence is not None
    assert default_prior("skimage") is default_prior(presets.paper(4))


def test_multi_scale() -> None:
    spec = presets.paper(8)
    descriptors = scale_descriptors(photograph(64), spec, (4, 1))
    levels = reconstruct_multiscale(descriptors, spec, scales=(4, 1), prior="default", search=FEW)
    assert levels[-1].reconstruction.polarity_confidence is not None


@pytest.mark.parametrize("spec", [presets.paper(8), presets.opencv()], ids=lambda spec: spec.name)
def test_details(spec: HOGSpec) -> None:
    """Found near what the signed prior expects of what is found near what the unsigned one does; at every scale."""
    image, search = photograph(128), Search(max_evaluations=100)
    with_them, without = (
        reconstruct(hog(image, spec), spec, prior=prior, search=search) for prior in ("default", default_prior(spec))
    )
    assert float(with_them.evaluations) <= 100
    assert len(with_them.history) == int(with_them.evaluations)
    assert not torch.equal(with_them.image, without.image)
    assert float(metrics.cross_correlation(with_them.image[0, 0], without.image[0, 0])) > 0.8


def test_several_priors() -> None:
    unsigned, signed = default_prior("paper"), default_prior("uoctti")
    descriptor = hog(photograph(64), "uoctti")
    one, other = (reconstruct(descriptor, "uoctti", prior=prior, search=FEW) for prior in (signed, [unsigned, signed]))
    assert torch.equal(one.image, other.image)
    for several in ([], [unsigned], [signed, signed]):
        with pytest.raises(ValueError, match="expected one prior for signed descriptors, and at most one for others"):
            reconstruct(descriptor, "uoctti", prior=several, search=FEW)


def test_what_is_no_prior() -> None:
    spec = presets.paper(8)
    wrong: list[Any] = ["best", [None]]
    for prior in wrong:
        with pytest.raises(TypeError, match=r"^prior must be a LearnedPrior, a list of these, 'default' or None, got"):
            reconstruct(hog(photograph(64), spec), spec, prior=prior, search=FEW)


@pytest.mark.parametrize(("spec", "kind"), [("paper", "unsigned"), ("vlfeat", "signed")])
def test_without_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec: str, kind: str) -> None:
    monkeypatch.setattr("nablahog.invert.prior_choice.FOLDER", tmp_path)
    descriptor = hog(photograph(64), spec)
    message = rf"^this installation of nablahog has no {kind}\.npz, the prior for {kind} descriptors: "
    with pytest.raises(FileNotFoundError, match=message):
        reconstruct(descriptor, spec, prior="default", search=FEW)
    assert reconstruct(descriptor, spec, search=FEW).polarity_confidence is None


@pytest.mark.parametrize("spec", ["paper", "uoctti"])
def test_where_they_are_from(spec: str) -> None:
    """README.md says which photographs, by their digest, which seed, and which weights it went on from."""
    prior, readme = default_prior(spec), (FOLDER / "README.md").read_text(encoding="utf-8")
    assert prior.learning.sha256 in readme
    assert f"{len(prior.learning.images):,} " in readme
    assert f"--epochs {prior.learning.epochs}" in readme
    assert f"seed {prior.learning.seed}" in readme
    assert prior.learning.start in readme


def test_they_are_small() -> None:
    assert sum(file.stat().st_size for file in FOLDER.glob("*.npz")) <= 16 * 10**6
