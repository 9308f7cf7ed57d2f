"""The priors that come with the package."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from nablahog import hog, presets, reconstruct, reconstruct_multiscale
from nablahog.hog import HOGSpec
from nablahog.invert import Search, default_prior, scale_descriptors
from nablahog.invert.prior_choice import FOLDER

from .photographs import photograph

FEW = Search(max_evaluations=4)
MISSING = r"^this installation of nablahog has no unsigned\.npz, the prior for unsigned descriptors: "


@pytest.mark.parametrize("spec", [presets.paper(8), presets.opencv(), presets.aubry(8)], ids=lambda spec: spec.name)
def test_by_default(spec: HOGSpec) -> None:
    descriptor = hog(photograph(128), spec)
    default, same = (
        reconstruct(descriptor, spec, prior=prior, search=FEW) for prior in ("default", default_prior(spec))
    )
    assert default.polarity_confidence is not None
    assert torch.equal(default.image, same.image)
    assert not torch.equal(default.image, reconstruct(descriptor, spec, search=FEW).image)


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


def test_descriptors_without_one() -> None:
    spec = presets.dpm()
    with pytest.raises(ValueError, match=r"^no prior for a dpm descriptor comes with the package: give one, or none$"):
        reconstruct(hog(photograph(64), spec), spec, prior="default", search=FEW)


def test_what_is_no_prior() -> None:
    spec = presets.paper(8)
    with pytest.raises(TypeError, match=r"^prior must be a LearnedPrior, 'default' or None, got 'best'$"):
        reconstruct(hog(photograph(64), spec), spec, prior="best", search=FEW)  # type: ignore[arg-type]


def test_without_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.prior_choice.FOLDER", tmp_path)
    spec = presets.paper(8)
    descriptor = hog(photograph(64), spec)
    with pytest.raises(FileNotFoundError, match=MISSING):
        reconstruct(descriptor, spec, prior="default", search=FEW)
    assert reconstruct(descriptor, spec, search=FEW).polarity_confidence is None


def test_where_they_are_from() -> None:
    """README.md says which photographs, by their digest, which seed, and which weights it went on from."""
    prior, readme = default_prior("paper"), (FOLDER / "README.md").read_text(encoding="utf-8")
    assert prior.learning.sha256 in readme
    assert f"{len(prior.learning.images):,} " in readme
    assert f"--epochs {prior.learning.epochs}" in readme
    assert f"--seed {prior.learning.seed} " in readme
    assert prior.learning.start in readme


def test_they_are_small() -> None:
    assert sum(file.stat().st_size for file in FOLDER.glob("*.npz")) <= 16 * 10**6
