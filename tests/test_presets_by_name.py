"""Where a public function takes a spec, it takes the name of a preset: those that are no columns of `boundary`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import torch
from torch import Tensor

import nablahog
from nablahog import HOGSpec, presets
from nablahog.invert import scale_descriptors
from nablahog.invert.prior.signed_network import Architecture
from nablahog.pose import default_background
from tests.public_surface import surface

IMAGE = torch.rand(64, 48, generator=torch.Generator().manual_seed(0))
DESCRIPTOR = nablahog.hog(IMAGE[None, None], presets.uoctti())


def _results(spec: HOGSpec | str) -> list[Tensor]:
    """What takes a spec makes of it."""
    small: dict[str, Any] = {"epochs": 1, "architecture": Architecture((8, 8, 8), (0, 0, 0))}
    prior = nablahog.train_prior({"noise": IMAGE}, spec, **small)
    prior.check(spec)
    few = nablahog.invert.Search(max_evaluations=5)
    return [
        *scale_descriptors(IMAGE[None, None], spec, (4, 1)),
        default_background(spec, 1).mean,
        prior.expected(DESCRIPTOR, spec, (64, 48)),
        nablahog.reconstruct(DESCRIPTOR, spec, prior=prior, search=few).image,
    ]


@pytest.mark.slow
def test_a_name_is_the_preset_with_its_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.prior.training_windows.SignedTraining.default_crops", 1)
    assert all(map(torch.equal, _results("uoctti"), _results(presets.uoctti())))
    calls: list[Callable[[str], object]] = [
        lambda name: scale_descriptors(IMAGE[None, None], name, (4, 1)),
        lambda name: nablahog.train_prior({"noise": IMAGE}, name),
        lambda name: default_background(name, 1),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"^spec must be a HOGSpec or one of aubry, .*, got 'hog'$"):
            call("hog")


def test_no_public_function_takes_specs_alone() -> None:
    """But the constructors of what keeps a spec, and a spec's own methods."""
    alone = {
        name
        for name, signature in _signatures("", surface())
        if re.search(r": 'HOGSpec'[,)]", signature) and not name.startswith("HOGSpec")
    }
    assert alone == {"LearnedPrior"}


def _signatures(name: str, of: Any) -> Iterator[tuple[str, str]]:
    for key, value in of.items():
        inner = name if key in ("members", "signature") else f"{name}.{key}".lstrip(".")
        yield from _signatures(inner, value) if isinstance(value, dict) else [(inner, str(value))]
