"""The positive lasso: codes are optimal, and those of another solver."""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import nnls
from torch import Tensor

from nablahog.invert.baselines.hoggles import unit
from nablahog.invert.baselines.lasso import TOLERANCE, lasso


def _problem(atoms: int = 50, windows: int = 300, size: int = 20) -> tuple[Tensor, Tensor]:
    """Atoms that are much alike, as those of windows are, and windows."""
    common = torch.randn(size)
    dictionary = torch.randn(atoms, size) + common
    return dictionary / dictionary.norm(dim=1, keepdim=True), unit(torch.randn(windows, size) + common)


def test_codes_meet_the_conditions_of_the_optimum() -> None:
    dictionary, windows = _problem()
    for sparsity in (0.02, 0.3):
        codes = lasso(dictionary @ dictionary.T, windows @ dictionary.T, sparsity)
        ascent = (windows - codes @ dictionary) @ dictionary.T - sparsity
        assert codes.min() >= 0
        assert 0.02 < float((codes > 0).float().mean()) < 0.5
        assert ascent[codes > 0].abs().max() <= 1.1 * TOLERANCE * sparsity
        assert ascent[codes == 0].max() <= 1.1 * TOLERANCE * sparsity


def test_codes_are_those_of_another_solver() -> None:
    """Completing the square makes a positive lasso a non-negative least squares problem, where DᵀD has an inverse."""
    dictionary, windows = _problem(atoms=15, windows=10)
    codes = lasso(dictionary @ dictionary.T, windows @ dictionary.T, 0.05)
    root = torch.linalg.cholesky(dictionary.double() @ dictionary.double().T)
    target = torch.linalg.solve_triangular(root, (windows @ dictionary.T - 0.05).double().T, upper=False).T
    expected = np.stack([nnls(root.mT.numpy(), each.numpy())[0] for each in target])
    np.testing.assert_allclose(codes.numpy(), expected, atol=5e-3)


def test_codes_of_one_atom() -> None:
    windows = torch.tensor([[3.0, 0.0], [0.1, 5.0], [-3.0, 0.0]])
    atom = torch.tensor([[2.0, 0.0]])
    result = lasso(atom @ atom.T, windows @ atom.T, 0.5)
    torch.testing.assert_close(result, torch.tensor([[(6 - 0.5) / 4], [0.0], [0.0]]))


def test_codes_of_equal_and_of_empty_atoms() -> None:
    dictionary, windows = _problem()
    alone = lasso(dictionary @ dictionary.T, windows @ dictionary.T, 0.02)
    twice = torch.cat([dictionary, dictionary, torch.zeros(2, dictionary.shape[1])])
    result = lasso(twice @ twice.T, windows @ twice.T, 0.02)
    assert not result[:, -2:].any()
    torch.testing.assert_close(result @ twice, alone @ dictionary, atol=2e-3, rtol=0)


def test_codes_do_not_depend_on_threads(two_threads: None) -> None:
    dictionary, windows = _problem()
    problem = (dictionary @ dictionary.T, windows @ dictionary.T, 0.02)
    at_once = lasso(*problem)
    torch.set_num_threads(1)
    assert torch.equal(lasso(*problem), at_once)
