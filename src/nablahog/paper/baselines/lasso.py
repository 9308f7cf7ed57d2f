"""The positive lasso: sparse codes of vectors in a dictionary."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...runtime.threads import in_threads

TOLERANCE = 1e-3  # of ‖x‖²: how far the objective may be above its minimum
PORTION = 128  # codes that a thread computes in one go


def check_sparsity(sparsity: float) -> None:
    """Raises ValueError unless λ is finite and above 0."""
    if not 0 < sparsity < math.inf:
        raise ValueError(f"sparsity must be a finite number above 0, got {sparsity}")


def lasso(atoms: Tensor, vectors: Tensor, sparsity: float) -> Tensor:
    """The codes α ≥ 0 that minimise ½‖x - Dα‖² + λ‖α‖₁, for many x at once, by scikit-learn's coordinate descent.

    Args:
        atoms: Dᵀ, (K, n), float32 on the CPU, contiguous; an atom of length 0 is never used.
        vectors: x, (N, n), float32.
        sparsity: λ.

    Returns:
        (N, K), float32.  The objective is within ‖x‖² / 1000 of its minimum.

    Raises:
        ValueError: scikit-learn is not installed.
    """
    try:
        from sklearn.linear_model import Lasso
    except ModuleNotFoundError:
        raise ValueError("HOGgles needs scikit-learn: pip install 'nablahog[sklearn]'") from None
    codes = vectors.new_zeros(len(vectors), len(atoms))
    nonzero = vectors.any(1).nonzero().squeeze(1)  # the others' codes are 0; some versions warn of them
    portions, gram = torch.split(nonzero, PORTION), (atoms @ atoms.T).numpy()

    def code(portion: int) -> None:
        options = {"fit_intercept": False, "copy_X": False, "precompute": gram, "positive": True, "tol": TOLERANCE}
        one = Lasso(sparsity / atoms.shape[1], **options)
        one.fit(atoms.numpy().T, vectors[portions[portion]].numpy().T, check_input=False)
        codes[portions[portion]] = torch.from_numpy(one.coef_.reshape(-1, len(atoms)))

    in_threads(code, len(portions))
    return codes
