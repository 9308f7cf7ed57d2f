"""What linear detectors look for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.hog import FourBlockNorm, HOGSpec
from nablahog.hog.entries import cell_entries
from nablahog.invert import Search
from nablahog.invert.template import reconstruct_template, template_descriptor

SPECS: dict[str, HOGSpec] = {
    "dpm": presets.dpm(4),
    "uoctti": presets.uoctti(4),
    "skimage": presets.skimage(pixels_per_cell=(4, 4)),
    "dalal_triggs": presets.dalal_triggs(4, norm="L1-sqrt"),
    "opencv": presets.opencv((40, 40), (8, 8), (4, 4), (4, 4)),
    "maskfeat": presets.maskfeat(4),
    "paper": presets.paper(4),
    "directed": replace(presets.uoctti(4), normalizer=FourBlockNorm(parts=("directed", "texture"))),
}


def disc() -> Tensor:
    y, x = torch.meshgrid(torch.linspace(-1, 1, 40), torch.linspace(-1, 1, 40), indexing="ij")
    return (0.2 + 0.6 * torch.sigmoid(15 * (0.6 - torch.hypot(x, y))))[None, None]


def template(spec: HOGSpec) -> Tensor:
    """Of a disc against another picture, as a discriminant's weights would be."""
    noise = torch.rand(1, 1, 40, 40, generator=torch.Generator().manual_seed(0))
    return hog(disc(), spec) - hog(noise, spec)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SPECS if name != "paper"])  # whose signs are anybody's guess
def test_what_is_seen_has_the_shape_in_it(name: str) -> None:
    spec = SPECS[name]
    descriptor = template_descriptor(template(spec), spec)
    assert descriptor.shape == (1, *spec.grid(40, 40), spec.channels)
    assert torch.isfinite(descriptor).all()
    assert (descriptor >= 0).all()
    result = reconstruct(descriptor, spec, (40, 40), search=Search(max_evaluations=200), prior=None).image
    assert abs(np.corrcoef(result.flatten(), disc().flatten())[0, 1]) > 0.5


@pytest.mark.parametrize("name", SPECS)
def test_only_one_sign_counts(name: str) -> None:
    spec = SPECS[name]
    weights = template(spec)
    torch.testing.assert_close(template_descriptor(weights, spec, negative=True), template_descriptor(-weights, spec))
    torch.testing.assert_close(
        template_descriptor(3 * weights, spec), template_descriptor(weights, spec), rtol=1e-4, atol=1e-5
    )


def test_a_weight_becomes_an_edge_of_its_cell_and_bin() -> None:
    spec = presets.uoctti(4)
    weights = torch.full((1, 10, 10, spec.channels), -1.0)
    weights[0, 4, 6, 3] = 1.0
    entries = cell_entries(template_descriptor(weights, spec), spec)[0]
    assert torch.nonzero(entries).tolist() == [[3, 4, 6]]


def test_refusals() -> None:
    ones = torch.ones(1, 10, 10, 31)
    for weights, negative, says in (
        (torch.ones(1, 10, 10, 32), False, r"must have shape \(10, 10, 31\) .*, got \(10, 10, 32\)"),
        (torch.ones(3100), False, r"got \(3100,\).*from_layout"),
        (math.nan * ones, False, "the weights must be finite, got NaN or Inf"),
        (-ones, False, "a template has no positive weights of edges"),
        (ones, True, "a template has no negative weights of edges"),
    ):
        with pytest.raises(ValueError, match=says):
            template_descriptor(weights, presets.uoctti(4), negative=negative)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uoctti", "paper"])
def test_a_detector_likes_the_pre_image_of_its_weights(name: str) -> None:
    """More than that of what it dislikes; several searches of an unsigned one are averaged, and a seed repeats them."""
    image = torch.zeros(1, 1, 48, 48)
    image[..., 16:32, 8:40] = 1
    weights = hog(image, name) - 0.5 * hog(image.mT, name)
    few: dict[str, Any] = {"max_evaluations": 20, "seed": 3}
    liked, disliked = (reconstruct_template(weights, name, negative=negative, **few) for negative in (False, True))
    scores = [float((hog(result.image, name) * weights).sum()) for result in (liked, disliked)]
    assert scores[0] > 2 * scores[1]
    assert liked.image.shape == (1, 1, 48, 48)
    searches = 1 if name == "uoctti" else 6
    assert 20 * (searches - 1) < int(liked.evaluations) <= 20 * searches
    assert len(liked.history) == int(liked.evaluations)
    again = reconstruct_template(weights[0].numpy(), name, (48, 48), **few)
    np.testing.assert_array_equal(again.image, liked.image[0, 0].numpy())
