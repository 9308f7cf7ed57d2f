"""What must hold for any image: the contrast that a normaliser leaves, and images that are not changed."""

from __future__ import annotations

import pytest

from nablahog.hog import hog

from .zoo import PRESETS, SPECS, noise


@pytest.mark.parametrize("name", PRESETS)
def test_strong_edges_tell_the_contrast_where_the_normaliser_says_so(name: str) -> None:
    """About middle gray, which one dialect has beyond the border."""
    s, edges = PRESETS[name](4), noise(1, 1, 24, 24) - 0.5
    strong, half = (float(hog(128 / 255 + contrast * edges, s).norm()) for contrast in (1, 0.5))
    assert (half < 0.99 * strong) == s.normalizer.fixes_contrast


@pytest.mark.parametrize("name", ["aubry", "seeing3d"])
def test_faint_edges_show_the_contrast_beside_a_large_epsilon(name: str) -> None:
    s, edges = PRESETS[name](4), noise(1, 1, 24, 24) - 0.5
    faint, half = (float(hog(0.5 + contrast * edges, s).norm()) for contrast in (0.02, 0.01))
    assert half < 0.8 * faint


@pytest.mark.parametrize("name", SPECS)
def test_input_is_not_changed(name: str) -> None:
    image = noise(1, 3, 8, 8)
    before = image.clone()
    hog(image, SPECS[name])
    assert (image == before).all()
