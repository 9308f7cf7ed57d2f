"""Where a public function takes a spec, it takes the name of a preset: those that are no columns of `boundary`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import nablahog
from nablahog import HOGSpec, presets
from nablahog.invert import scale_descriptors
from nablahog.pose import default_background
from tests.public_surface import surface

IMAGE = torch.rand(64, 48, generator=torch.Generator().manual_seed(0))
DESCRIPTOR = nablahog.hog(IMAGE[None, None], presets.uoctti())[0].numpy()
FEW = nablahog.invert.Search(max_evaluations=5)

Spec = HOGSpec | str


def _prior(spec: Spec, folder: Path) -> object:
    prior = nablahog.train_prior({"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}, spec)
    tensor = torch.from_numpy(DESCRIPTOR)[None]
    prior.check(spec)
    return prior.expected(tensor, spec, (64, 48)), nablahog.reconstruct(tensor, spec, prior=prior, search=FEW).image


CALLS: dict[str, Callable[[Any, Path], object]] = {
    "scale_descriptors": lambda spec, _: scale_descriptors(IMAGE[None, None], spec, (4, 1)),
    "LearnedPrior": _prior,
    "default_background": lambda spec, _: default_background(spec, 1).mean,
}


def _arrays(result: object) -> Iterator[object]:
    """What a call gives, as what can be compared."""
    if isinstance(result, list | tuple):
        for each in result:
            yield from _arrays(each)
    else:
        yield result.tolist() if isinstance(result, torch.Tensor | np.ndarray) else result


@pytest.mark.parametrize("call", CALLS)
def test_a_name_is_the_preset_with_its_defaults(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.prior.training_windows.SignedTraining.default_crops", 1)
    by_name, by_spec = (CALLS[call](spec, tmp_path) for spec in ("uoctti", presets.uoctti()))
    assert list(_arrays(by_name)) == list(_arrays(by_spec))
    with pytest.raises(ValueError, match=r"^spec must be a HOGSpec or one of aubry, .*, got 'hog'$"):
        CALLS[call]("hog", tmp_path)


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
