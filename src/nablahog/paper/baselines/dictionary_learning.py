"""Online learning of a dictionary for sparse codes.

Mairal, Bach, Ponce and Sapiro, *Online Dictionary Learning for Sparse Coding* (ICML 2009), as the published code of
HOGgles has it done by SPAMS: each batch is coded, the sums AᵀA and AᵀX of its codes A and windows X are added to those
of the past, which count less and less, and each atom in turn takes its best value for them, of length 1 at most.

scikit-learn's ``MiniBatchDictionaryLearning`` has the same steps, but no state that a checkpoint could hold; SPAMS is
under the GPL.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...invert.checkpoint import Checkpoint
from ...io.npz import text
from .lasso import lasso

UNUSED = 1e-6  # mean square of an atom's weights below which it counts as unused
PATIENCE = 25  # batches before unused atoms are replaced by windows
BLOCK = 64  # atoms that are updated between two products of large matrices


class DictionaryLearner:
    """A dictionary that is updated with every batch.

    Args:
        atoms: the initial ones, (K, n), float32, each of length 1.
        sparsity: λ.
        rng: of the windows that replace unused atoms.

    Attributes:
        atoms: (K, n), each of length 1 at most.
        batches: the number of batches learned.
    """

    def __init__(self, atoms: Tensor, sparsity: float, rng: np.random.Generator) -> None:
        self.atoms = atoms.clone()
        self.sparsity = sparsity
        self.rng = rng
        self.batches = 0
        self._codes = atoms.new_zeros(len(atoms), len(atoms))  # AᵀA / N
        self._products = torch.zeros_like(atoms)  # AᵀX / N

    def learn(self, windows: Tensor) -> float:
        """One iteration, with ``windows`` (N, n).  Returns their mean ½‖x - Dα‖² + λ‖α‖₁ before it."""
        codes = lasso(self.atoms, windows, self.sparsity)
        residual = windows - codes @ self.atoms
        objective = float(residual.square().sum() / 2 + self.sparsity * codes.sum()) / len(windows)
        past = self._forgetting(len(windows))
        self._codes.mul_(past).addmm_(codes.T, codes, alpha=1 / len(windows))
        self._products.mul_(past).addmm_(codes.T, windows, alpha=1 / len(windows))
        self.batches += 1
        self._update(windows)
        return objective

    def state(self) -> dict[str, Any]:
        """All that changes with a batch, as arrays by name."""
        return {
            "batches": np.array(self.batches),
            "dictionary": self.atoms.numpy(),
            "codes": self._codes.numpy(),
            "products": self._products.numpy(),
            "random": np.array(json.dumps(self.rng.bit_generator.state)),
        }

    def restore(self, checkpoint: Checkpoint, iterations: int) -> list[float]:
        """Sets the state to that of the checkpoint, if there is one.  Returns the objectives stored beside it.

        Raises:
            ValueError, OSError: as :meth:`.Checkpoint.restore`.
        """
        return checkpoint.restore(lambda arrays: self._read(arrays, iterations)) or []

    def _read(self, arrays: dict[str, NDArray[np.generic]], iterations: int) -> list[float]:
        """Sets the state to that in ``arrays``.  Returns the objectives in them.

        Raises:
            ArithmeticError, LookupError, RecursionError, TypeError, ValueError: the state is impossible, of more than
                ``iterations`` batches, and not set.
        """
        for name, current in self.state().items():
            array = arrays[name]
            if array.dtype.kind != current.dtype.kind or array.shape != current.shape:
                raise ValueError(f"{name} is {array.dtype} of shape {array.shape}")
            if array.dtype.kind == "f" and not np.isfinite(array.astype(np.float32)).all():
                raise ValueError(f"{name} is not finite")
        batches = int(arrays["batches"].item())
        objective = [float(each) for each in arrays["objective"].astype(np.float64)]
        if not 1 <= batches <= iterations or not np.isfinite(objective).all():
            raise ValueError(f"impossible: {batches} batches of {iterations}, or an objective")
        rng = np.random.default_rng()  # another one, because what is impossible may be half set
        rng.bit_generator.state = json.loads(text(arrays, "random"))
        self.rng.bit_generator.state = rng.bit_generator.state
        self.batches = batches
        self.atoms, self._codes, self._products = (
            torch.from_numpy(arrays[name].astype(np.float32)) for name in ("dictionary", "codes", "products")
        )
        return objective

    def _forgetting(self, size: int) -> float:
        """The factor of the sums over earlier batches, which were coded with worse atoms."""
        seen = self.batches * size if self.batches < size else size * size + self.batches - size
        return (seen + 1 - size) / (seen + 1) if seen >= size else 0.0

    def _update(self, windows: Tensor) -> None:
        """Each atom in turn to its best value, the others being fixed: block coordinate descent.

        Blocks only save time: the product with all atoms is made once a block, and corrected by the changes within it.
        """
        used = self._codes.diagonal() > UNUSED
        for first in range(0, len(self.atoms), BLOCK):
            block = slice(first, min(first + BLOCK, len(self.atoms)))
            residual = self._products[block] - self._codes[block] @ self.atoms
            changes = torch.zeros_like(residual)
            for k in range(block.stop - first):
                i = first + k
                if not used[i]:
                    continue
                step = residual[k] - self._codes[i, first:i] @ changes[:k]
                atom = self.atoms[i] + step / self._codes[i, i]
                atom /= atom.norm().clamp(min=1)
                changes[k] = atom - self.atoms[i]
                self.atoms[i] = atom
        unused = (~used).nonzero()[:, 0]
        if self.batches >= PATIENCE and len(unused):
            chosen = windows[torch.from_numpy(self.rng.integers(len(windows), size=len(unused)))]
            self.atoms[unused] = chosen / chosen.norm(dim=1, keepdim=True).clamp(min=1)
