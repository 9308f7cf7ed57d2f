"""The positive lasso: sparse codes of vectors in a dictionary, by coordinate descent."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...runtime.compile import compiled
from ...runtime.threads import in_threads

TOLERANCE = 1e-2  # of the sparsity: how far the conditions of the optimum may be missed
MAX_ROUNDS = 200  # of a code; it takes some ten
PORTION = 128  # codes that a thread computes in one go


def check_sparsity(sparsity: float) -> None:
    """Raises ValueError unless λ is finite and above 0."""
    if not 0 < sparsity < math.inf:
        raise ValueError(f"sparsity must be a finite number above 0, got {sparsity}")


def lasso(gram: Tensor, correlations: Tensor, sparsity: float) -> Tensor:
    """The codes α ≥ 0 that minimise ½‖x - Dα‖² + λ‖α‖₁, for many x at once.

    Coordinate descent runs on an active set of atoms, to which those are added that violate the conditions of the
    optimum most: of a thousand atoms a code uses a hundred or two.

    Args:
        gram: DᵀD of the atoms, (K, K), float32 on the CPU; an atom of length 0 is never used.
        correlations: Dᵀx, (N, K).
        sparsity: λ.

    Returns:
        (N, K), float32.  The derivative of the objective is within λ/100 of 0 where a code is positive, and above
        -λ/100 elsewhere.
    """
    codes = np.zeros(correlations.shape, np.float32)
    gram_array, correlation_array = gram.contiguous().numpy(), correlations.contiguous().numpy()
    weight, tolerance = np.float32(sparsity), np.float32(TOLERANCE * sparsity)

    def code(portion: int) -> None:
        part = slice(portion * PORTION, (portion + 1) * PORTION)
        _lasso(gram_array, correlation_array[part], weight, tolerance, MAX_ROUNDS, codes[part])

    in_threads(code, -(-len(codes) // PORTION))
    return torch.from_numpy(codes)


@compiled
def _lasso(gram: Any, correlations: Any, sparsity: Any, tolerance: Any, max_rounds: int, codes: Any) -> None:
    """Writes the codes (N, K), zeros at first, for ``correlations`` (N, K)."""
    count, atoms = correlations.shape
    zero = sparsity * 0
    ascent = np.empty(atoms, correlations.dtype)  # minus the derivative
    active = np.empty(atoms, np.int64)  # the active set
    active_gram = np.empty(atoms * atoms, correlations.dtype)  # dense, to stay in cache
    active_ascent, values = np.empty(atoms, correlations.dtype), np.empty(atoms, correlations.dtype)
    for i in range(count):
        code = codes[i]
        for _ in range(max_rounds):
            for k in range(atoms):
                ascent[k] = correlations[i, k] - sparsity
            for k in range(atoms):
                value = code[k]
                if value > 0:
                    row = gram[k]
                    for m in range(atoms):
                        ascent[m] -= value * row[m]
            violation = zero
            for k in range(atoms):
                if gram[k, k] > 0:
                    violation = max(violation, abs(ascent[k]) if code[k] > 0 else ascent[k])
            if not violation > tolerance:
                break
            size = 0
            for k in range(atoms):
                if gram[k, k] > 0 and (code[k] > 0 or 2 * ascent[k] > violation):
                    active[size] = k
                    size += 1
            for n in range(size):
                k = active[n]
                values[n], active_ascent[n] = code[k], ascent[k]
                row, full_row = active_gram[n * size : (n + 1) * size], gram[k]
                for m in range(size):
                    row[m] = full_row[active[m]]
            _descend(active_gram, active_ascent, values, size, max(tolerance, violation) / 4)
            for n in range(size):
                code[active[n]] = max(values[n], zero)


@compiled
def _descend(gram: Any, ascent: Any, values: Any, size: int, tolerance: Any) -> None:
    """Coordinate descent on the first ``size`` values and their ascent, until a sweep changes little."""
    zero = tolerance * 0
    for _ in range(1000):
        largest = zero
        for n in range(size):
            row = gram[n * size : (n + 1) * size]
            step = max(values[n] + ascent[n] / row[n], zero) - values[n]
            if step != 0:
                values[n] += step
                for m in range(size):
                    ascent[m] -= step * row[m]
                largest = max(largest, abs(step) * row[n])
        if not largest > tolerance:
            break
