"""Online dictionary learning: atoms are those of a plain loop, and unused ones are replaced."""

from __future__ import annotations

import numpy as np
import torch

from nablahog.paper.baselines.dictionary_learning import PATIENCE, DictionaryLearner
from nablahog.paper.baselines.hoggles import unit
from nablahog.paper.baselines.lasso import lasso


def test_atoms_are_updated_one_after_the_other() -> None:
    """Blocks of them give what a plain loop gives, and the objective that they approximate falls."""
    data = unit(torch.rand(500, 30))
    learner = DictionaryLearner(data[:150], 0.02, np.random.default_rng(0))
    codes = lasso(learner.atoms, data, 0.02).double()
    expected, products, target = learner.atoms.double(), codes.T @ codes / 500, codes.T @ data.double() / 500
    before = ((data - codes @ expected) ** 2).sum()
    for k in range(150):
        if products[k, k] > 1e-6:
            atom = expected[k] + (target[k] - products[k] @ expected) / products[k, k]
            expected[k] = atom / max(1.0, float(atom.norm()))
    learner.learn(data)
    torch.testing.assert_close(learner.atoms.double(), expected, atol=1e-4, rtol=0)
    assert ((data - codes @ learner.atoms.double()) ** 2).sum() < before
    assert learner.atoms.norm(dim=1).max() < 1 + 1e-5


def test_atoms_that_are_not_used_give_way() -> None:
    windows = unit(torch.rand(50, 6))
    learner = DictionaryLearner(torch.cat([windows[:5], torch.zeros(1, 6)]), 0.02, np.random.default_rng(0))
    for _ in range(PATIENCE):
        assert not learner.atoms[5].any()
        learner.learn(windows)
    assert any(torch.allclose(learner.atoms[5], window) for window in windows)
