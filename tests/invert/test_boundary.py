"""Whatever a caller has set and passes, a pre-image is the same or refused."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import (
    hog,
    reconstruct,
    reconstruct_multiscale,
    save_descriptor,
    template_descriptor,
    train_prior,
)
from nablahog.invert import AsPublished, Search, default_prior

IMAGE = torch.nn.functional.avg_pool2d(torch.rand(1, 1, 64, 64, generator=torch.Generator().manual_seed(0)), 5, 1, 2)
FEW = Search(max_evaluations=20)


@pytest.fixture(params=[torch.float64, torch.float16], ids=str)
def other_default(request: pytest.FixtureRequest) -> Iterator[torch.dtype]:
    yield request.param
    torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("name", ["uoctti", "paper"])
def test_another_default_dtype_gives_the_same_pre_image(name: str, other_default: torch.dtype) -> None:
    descriptor = hog(IMAGE, name)
    ways = [
        lambda: reconstruct(descriptor, name, search=FEW).image,
        lambda: reconstruct(descriptor, name, method=AsPublished(iterations=2)).image,
        lambda: reconstruct_multiscale(descriptor, name, scales=(4, 1), search=FEW)[-1].reconstruction.image,
    ]
    expected = [way() for way in ways]
    torch.set_default_dtype(other_default)
    for way, image in zip(ways, expected, strict=True):
        assert torch.equal(way(), image)


def test_another_default_dtype_trains_the_same_prior(other_default: torch.dtype) -> None:
    images = {"noise": IMAGE[0, 0].repeat(2, 2)}
    expected = train_prior(images, "uoctti", epochs=1).weights
    torch.set_default_dtype(other_default)
    assert torch.equal(train_prior(images, "uoctti", epochs=1).weights, expected)
    assert torch.get_default_dtype() == other_default


@pytest.mark.parametrize("size", [(32.5, 32), (32, 32, 3), (), 32, "32x32"])
def test_what_is_no_size_is_refused_by_every_function(size: object, tmp_path: Path) -> None:
    descriptor = hog(IMAGE[..., :32, :32], "uoctti")
    calls = [
        lambda: reconstruct(descriptor, "uoctti", size),
        lambda: reconstruct_multiscale(descriptor, "uoctti", size, scales=(4, 1)),
        lambda: template_descriptor(descriptor, "uoctti", size),
        lambda: save_descriptor(tmp_path / "x.npz", descriptor[0], "uoctti", size),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"image_size must be a pair \(height, width\) of integers"):
            call()
    assert not (tmp_path / "x.npz").exists()


def test_sizes_are_arrays_and_tensors_too(tmp_path: Path) -> None:
    descriptor = hog(IMAGE[..., :32, :32], "uoctti")
    for size in (np.array([32, 32]), torch.tensor([32, 32])):
        assert torch.equal(template_descriptor(descriptor, "uoctti", size), template_descriptor(descriptor, "uoctti"))
        levels = reconstruct_multiscale(descriptor, "uoctti", size, scales=(4, 1), search=Search(max_evaluations=4))
        assert levels[-1].reconstruction.image.shape == (1, 1, 32, 32)
        save_descriptor(tmp_path / "x.npz", descriptor[0], "uoctti", size)


def test_halves_are_no_seeds_evaluations_or_weights() -> None:
    descriptor = hog(IMAGE, "uoctti")
    with pytest.raises(ValueError, match="seed must be an integer"):
        reconstruct(descriptor, "uoctti", seed=1.5)
    with pytest.raises(ValueError, match="max_evaluations must be an integer"):
        Search(max_evaluations=10.5)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"float32 or float64 tensor.*write weights\.float\(\)"):
        template_descriptor(descriptor.half(), "uoctti")
    with pytest.raises(ValueError, match="expected is an option of the default method"):
        reconstruct(descriptor.numpy(), "uoctti", method="paper", expected=np.zeros((64, 64)))


def test_a_prior_learns_from_arrays_and_pil_images_as_from_tensors() -> None:
    levels = (torch.rand(64, 64, generator=torch.Generator().manual_seed(0)) * 255).byte()
    kinds = levels.float() / 255, levels, levels.numpy(), Image.fromarray(levels.numpy())
    weights = [train_prior({"a": image}, "uoctti", epochs=1, seed=np.int64(0)).weights for image in kinds]
    assert all(torch.equal(weights[0], same) for same in weights[1:])
    with pytest.raises(TypeError, match="images must be a dict of images by name, got list: write "):
        train_prior([levels], "uoctti", epochs=1)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"a must be gray, \(H, W\), got shape"):
        train_prior({"a": levels[None]}, "uoctti", epochs=1)


def test_samples_in_several_threads_are_those_of_one() -> None:
    descriptor, prior = hog(IMAGE, "paper"), default_prior("paper")

    def draw(seed: int) -> torch.Tensor:
        return prior.samples(descriptor, "paper", (64, 64), 2, seed=seed)

    expected = [draw(seed) for seed in range(4)]
    assert not torch.equal(expected[0], expected[1])
    with ThreadPoolExecutor(3) as pool:
        assert all(map(torch.equal, pool.map(draw, range(4)), expected))


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
