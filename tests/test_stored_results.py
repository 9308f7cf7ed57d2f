"""Results of searches and trainings change on purpose only."""

from __future__ import annotations

import json

import numpy as np
import pytest

from .stored_results import POSES, SEARCHES, SEARCHES_WITH_PRIOR, STORED, TRAININGS

EXPECTED = json.loads(STORED.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", SEARCHES)
def test_searches_find_what_they_found(name: str) -> None:
    np.testing.assert_allclose(SEARCHES[name](), EXPECTED[name], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", SEARCHES_WITH_PRIOR)
def test_searches_with_a_prior_find_nearly_what_they_found(name: str) -> None:
    np.testing.assert_allclose(SEARCHES_WITH_PRIOR[name](), EXPECTED[name], rtol=0, atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", POSES)
def test_poses_are_nearly_those_that_were_found(name: str) -> None:
    """Plain PyTorch finds azimuths that are up to 0.4° off these; sides of boxes are pixels."""
    np.testing.assert_allclose(POSES[name](), EXPECTED[name], rtol=0.03, atol=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", TRAININGS)
def test_trainings_have_the_losses_that_they_had(name: str) -> None:
    np.testing.assert_allclose(TRAININGS[name](), EXPECTED[name], rtol=0, atol=0.002)
