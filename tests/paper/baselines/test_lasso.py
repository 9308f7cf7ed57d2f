"""The positive lasso: codes are optimal, and those of another solver."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import torch
from scipy.optimize import nnls
from torch import Tensor

from nablahog.paper.baselines.hoggles import unit
from nablahog.paper.baselines.lasso import TOLERANCE, lasso


def _problem(atoms: int = 50, windows: int = 300, size: int = 20) -> tuple[Tensor, Tensor]:
    """Atoms that are much alike, as those of windows are, and windows."""
    common = torch.randn(size)
    dictionary = torch.randn(atoms, size) + common
    return dictionary / dictionary.norm(dim=1, keepdim=True), unit(torch.randn(windows, size) + common)


def test_no_codes_are_better() -> None:
    """The objective is hardly above that of a point of the dual problem, and so above the minimum."""
    dictionary, windows = (part.double() for part in _problem())
    for sparsity in (0.02, 0.3):
        codes = lasso(dictionary.float(), windows.float(), sparsity).double()
        assert codes.min() >= 0
        assert 0.02 < float((codes > 0).float().mean()) < 0.5
        residual = windows - codes @ dictionary
        primal = residual.square().sum(1) / 2 + sparsity * codes.sum(1)
        dual_point = residual * (sparsity / (residual @ dictionary.T).amax(1, keepdim=True)).clamp(max=1)
        dual = (windows.square() - (windows - dual_point).square()).sum(1) / 2
        assert (primal - dual).max() < 1.1 * TOLERANCE


def test_codes_are_those_of_another_solver() -> None:
    """Completing the square makes a positive lasso a non-negative least squares problem, where DᵀD has an inverse."""
    dictionary, windows = _problem(atoms=15, windows=10)
    codes = lasso(dictionary, windows, 0.05)
    root = torch.linalg.cholesky(dictionary.double() @ dictionary.double().T)
    target = torch.linalg.solve_triangular(root, (windows @ dictionary.T - 0.05).double().T, upper=False).T
    expected = np.stack([nnls(root.mT.numpy(), each.numpy())[0] for each in target])
    np.testing.assert_allclose(codes.numpy(), expected, atol=5e-3)


def test_codes_of_one_atom() -> None:
    windows = torch.tensor([[3.0, 0.0], [0.1, 5.0], [-3.0, 0.0]])
    atom = torch.tensor([[2.0, 0.0]])
    result = lasso(atom, windows, 0.5)
    torch.testing.assert_close(result, torch.tensor([[(6 - 0.5) / 4], [0.0], [0.0]]))


def test_codes_of_equal_and_of_empty_atoms() -> None:
    dictionary, windows = _problem()
    alone = lasso(dictionary, windows, 0.02)
    twice = torch.cat([dictionary, dictionary, torch.zeros(2, dictionary.shape[1])])
    result = lasso(twice, windows, 0.02)
    assert not result[:, -2:].any()
    torch.testing.assert_close(result @ twice, alone @ dictionary, atol=2e-3, rtol=0)


def test_codes_do_not_depend_on_threads(two_threads: None) -> None:
    dictionary, windows = _problem()
    problem = (dictionary, windows, 0.02)
    at_once = lasso(*problem)
    torch.set_num_threads(1)
    assert torch.equal(lasso(*problem), at_once)


def test_windows_of_0_have_no_codes() -> None:
    dictionary, windows = _problem()
    windows[3] = 0
    codes = lasso(dictionary, windows, 0.02)
    assert not codes[3].any()
    assert codes[:3].any(1).all()
    assert not lasso(dictionary, torch.zeros(2, 20), 0.02).any()


def test_says_that_it_needs_scikit_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.linear_model", None)
    with pytest.raises(ValueError, match=r"scikit-learn.*nablahog\[sklearn\]"):
        lasso(*_problem(), 0.02)
