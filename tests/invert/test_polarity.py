"""Which of an image and its negative is the photograph."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from nablahog.invert.polarity import WEIGHTS, brightness_cues, fix_polarity, looks_negative, negated

from .photographs import photograph


def noise(height: int, width: int, seed: int = 0, batch: int = 1) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(batch, 1, height, width, generator=generator, dtype=torch.float64)


def sky(size: int = 64) -> Tensor:
    """White above, dark texture below."""
    image = torch.full((1, 1, size, size), 0.97, dtype=torch.float64)
    image[..., size // 2 :, :] = 0.1 + 0.3 * noise(size - size // 2, size)
    return image


@given(
    height=st.integers(1, 20),
    width=st.integers(1, 20),
    seed=st.integers(0, 1000),
    contrast=st.sampled_from([0.05, 1.0]),
)
def test_every_cue_changes_its_sign_with_the_image(height: int, width: int, seed: int, contrast: float) -> None:
    image = 0.3 + contrast * (noise(height, width, seed, batch=2) - 0.3)
    cues = brightness_cues(image)
    assert cues.shape == (2, 4)
    torch.testing.assert_close(brightness_cues(1 - image), -cues, atol=1e-6, rtol=1e-6)
    decided = (cues @ torch.tensor(WEIGHTS, dtype=torch.float64)).abs() > 1e-6
    torch.testing.assert_close(fix_polarity(1 - image)[decided], fix_polarity(image)[decided])


@pytest.mark.parametrize("name", ["camera", "coins", "coffee", "astronaut", "page", "moon"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_every_cue_changes_its_sign_with_a_photograph(name: str, dtype: torch.dtype) -> None:
    image = photograph(96, name).to(dtype)
    torch.testing.assert_close(brightness_cues(1 - image), -brightness_cues(image), atol=1e-4, rtol=1e-4)


@given(height=st.integers(1, 20), width=st.integers(1, 20), seed=st.integers(0, 1000))
def test_correlations_are_correlations(height: int, width: int, seed: int) -> None:
    cues = brightness_cues(noise(height, width, seed))
    assert cues[:, :3].abs().max() <= 1 + 1e-9


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (1, 9), (9, 1), (2, 2), (3, 3), (2, 20), (7, 40), (8, 8), (17, 31)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_images_of_a_few_pixels_and_constant_ones_have_finite_cues(size: tuple[int, int], dtype: torch.dtype) -> None:
    for image in (noise(*size).to(dtype), *(torch.full((1, 1, *size), gray, dtype=dtype) for gray in (0, 0.3, 0.7, 1))):
        cues = brightness_cues(image)
        assert cues.shape == (1, 4)
        assert cues.dtype == dtype
        assert torch.isfinite(cues).all()
        assert fix_polarity(image).shape == image.shape
        assert fix_polarity(image).dtype == dtype


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_constant_image_says_nothing(dtype: torch.dtype) -> None:
    for gray in (0.1, 0.3, 0.5, 0.7, 0.9):
        image = torch.full((1, 1, 16, 16), gray, dtype=dtype)
        assert (brightness_cues(image) == 0).all()
        assert torch.equal(fix_polarity(image), image)


def test_each_image_of_a_batch_is_judged_by_itself() -> None:
    images = torch.cat([sky(), 1 - sky(), noise(64, 64), photograph(64).double()])
    torch.testing.assert_close(brightness_cues(images), torch.cat([brightness_cues(image[None]) for image in images]))
    assert torch.equal(fix_polarity(images), torch.cat([fix_polarity(image[None]) for image in images]))


def test_upright_is_the_image_or_its_negative_by_the_sum_of_the_cues() -> None:
    names = ("camera", "coins", "coffee", "astronaut", "page", "moon")
    images = torch.cat([photograph(64, name) for name in names])
    images = torch.cat([images, 1 - images])
    score = (brightness_cues(images) * torch.tensor(WEIGHTS)).sum(dim=1)
    assert torch.equal(looks_negative(images), score < 0)
    for image, made, number in zip(images, fix_polarity(images), score, strict=True):
        assert torch.equal(made, image if number >= 0 else 1 - image)
    torch.testing.assert_close(fix_polarity(fix_polarity(images)), fix_polarity(images))
    torch.testing.assert_close(fix_polarity(1 - images), fix_polarity(images))


def test_negated_is_the_negative_where_asked() -> None:
    images = noise(5, 6, batch=3)
    made = negated(images, torch.tensor([True, False, True]))
    assert torch.equal(made, torch.stack([1 - images[0], images[1], 1 - images[2]]))


def test_a_flat_sky_is_bright() -> None:
    image = sky()
    exactly_flat, flat, _, _ = brightness_cues(image)[0]
    assert exactly_flat > 0.7
    assert flat > 0.7
    assert torch.equal(fix_polarity(image), image)
    torch.testing.assert_close(fix_polarity(1 - image), image)


def test_a_sky_that_is_not_exactly_flat() -> None:
    image = sky()
    image[..., :32, :] = 0.95 + 0.008 * noise(32, 64)
    exactly_flat, flat, _, _ = brightness_cues(image)[0]
    assert exactly_flat == 0
    assert flat > 0.7
    torch.testing.assert_close(fix_polarity(1 - image), image)


def test_one_flat_patch_in_a_hundred_says_nothing() -> None:
    image = noise(80, 80)
    image[..., 8:16, 8:16] = 1
    assert (brightness_cues(image)[0, :2] == 0).all()


def test_contrast_is_stronger_in_the_light() -> None:
    # reflectances, shaded from left to right
    light = torch.linspace(0.1, 1, 64, dtype=torch.float64).reshape(1, 1, 1, 64)
    assert brightness_cues(light * (0.3 + 0.7 * noise(64, 64)))[0, 2] > 0.7


def test_highlights_are_small_and_bright() -> None:
    image = torch.full((1, 1, 32, 32), 0.2, dtype=torch.float64)
    image[..., 4::8, 4::8] = 1
    assert brightness_cues(image)[0, 3] > 1
