"""Whatever a caller has set and passes, a pre-image is the same or refused."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from nablahog import (
    hog,
    reconstruct,
    train_prior,
)
from nablahog.invert import AsPublished, Search, default_prior

IMAGE = torch.nn.functional.avg_pool2d(torch.rand(1, 1, 64, 64, generator=torch.Generator().manual_seed(0)), 5, 1, 2)
FEW = Search(max_evaluations=20)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16])
def test_another_default_dtype_gives_the_papers_pre_image(dtype: torch.dtype) -> None:
    descriptor = hog(IMAGE, "uoctti")
    expected = reconstruct(descriptor, "uoctti", method=AsPublished(iterations=2)).image
    torch.set_default_dtype(dtype)
    try:
        image = reconstruct(descriptor, "uoctti", method=AsPublished(iterations=2)).image
    finally:
        torch.set_default_dtype(torch.float32)
    assert torch.equal(image, expected)


def test_options_of_another_method_are_refused() -> None:
    with pytest.raises(ValueError, match="expected is an option of the default method"):
        reconstruct(hog(IMAGE, "uoctti"), "uoctti", method="paper", expected=np.zeros((64, 64)))


def test_images_to_learn_from_have_names() -> None:
    with pytest.raises(TypeError, match="images must be a dict of images by name, got list: write "):
        train_prior([IMAGE[0, 0]], "uoctti", epochs=1)  # type: ignore[arg-type]


def test_priors_refuse_what_does_not_go_with_the_descriptor() -> None:
    prior, descriptor = default_prior("paper"), hog(IMAGE, "paper")
    histograms = torch.zeros(2, 9, 8, 8)  # of another batch
    for call in (
        lambda: prior.expected(descriptor, "paper", (64, 64), histograms),
        lambda: prior.expected(descriptor.to_sparse(), "paper", (64, 64)),
        lambda: prior.expected(descriptor, "paper", 64),  # type: ignore[arg-type]
        lambda: prior.samples(descriptor, "paper", (64, 64), 2.5),  # type: ignore[arg-type]
        lambda: prior.samples(descriptor, "paper", (64, 64), 2, seed="a"),  # type: ignore[arg-type]
        lambda: prior.polarity_confidence(IMAGE.repeat(2, 1, 1, 1), descriptor, "paper"),
        lambda: reconstruct(descriptor, "paper", search="fast"),  # type: ignore[arg-type]
    ):
        with pytest.raises((TypeError, ValueError), match="must"):
            call()
