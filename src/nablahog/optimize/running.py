"""The problems of a batch that still run, and why the others have ended, on their device: to read it is to wait for it.

On a CPU there is nothing to wait for, and a problem is dropped in the round in which it ends.  On a device a problem
that has ended stays as it is, by masks, and is evaluated again at its last point until the next look; only then the
numbers are read, once, and all that have ended are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

import numpy as np
import torch
from torch import Tensor

from .result import History, Minimum, Numbers, StopReason, Watch

WINDOW = 20  # evaluations over which progress is judged
ROUNDS_BETWEEN_LOOKS = 10  # on a device: more waste evaluations of problems that have ended, fewer wait more often
_REASONS = tuple(StopReason)
_CODES = {reason: k + 1 for k, reason in enumerate(_REASONS)}


def dropped_at_once(like: Tensor) -> bool:
    """Whether problems with such unknowns are dropped in the round in which they end: nothing is waited for."""
    return like.device.type == "cpu"


def as_numbers(tensor: Tensor) -> Numbers:
    """On a CPU as an array of NumPy, else as it is."""
    return tensor.numpy() if dropped_at_once(tensor) else tensor


def array_namespace(numbers: Numbers) -> ModuleType:
    """NumPy or PyTorch: their functions of one name do the same, as the array API standard says."""
    return np if isinstance(numbers, np.ndarray) else torch


def of_rows(numbers: Numbers, rows: Tensor) -> Numbers:
    """Some rows (A',), given on the CPU, of numbers (A, …)."""
    return numbers[rows.to(numbers.device) if isinstance(numbers, Tensor) else rows.numpy()]


def may_hold(mask: Numbers) -> bool:
    """Whether ``mask`` (A,) holds for a problem; of a tensor it may, since its device would be waited for."""
    return isinstance(mask, Tensor) or bool(np.count_nonzero(mask))


def rows_where(mask: Numbers) -> Tensor | slice:
    """The rows for which ``mask`` (A,) holds; of a tensor all, since its device would be waited for."""
    return slice(None) if isinstance(mask, Tensor) else torch.from_numpy(mask.nonzero()[0])


class Running:
    """The running problems of a batch of B; on a device, those that have ended since the last look are among them.

    Args:
        start: (B, N).
        values: (B,) there, a tensor or an array as all other numbers will be.
        watch: told of each evaluation.

    Attributes:
        at_once: whether problems that end are dropped at once.
        index: (A,), the problems.
        codes: (A,), 0, or why they have ended.
        evaluations: (A,), of each until it ended.
    """

    def __init__(self, start: Tensor, values: Numbers, watch: Watch | None) -> None:
        self.at_once, self.watch = dropped_at_once(start), watch
        self.index, self._problems = torch.arange(len(start), device=start.device), torch.arange(len(start))
        self._xp = array_namespace(values)
        self.codes, self.evaluations = (
            self._xp.zeros_like(values, dtype=kind) for kind in (self._xp.int8, self._xp.int64)
        )
        self._lowest, self._rounds = values, 0
        self._recent = self._xp.stack([self._xp.full_like(values, np.inf)] * (WINDOW + 1))
        self._history = History(len(start))
        self._x, self._values = torch.empty_like(start), start.new_empty(len(start))
        self._spent, self._reasons = torch.zeros_like(self.index), [StopReason.BUDGET] * len(start)
        self.count(values)

    def count(self, values: Numbers, evaluations: Numbers | None = None) -> None:
        """They have been evaluated, and are now where the objective has the ``values`` (A,).

        ``evaluations`` (A,) are by default one more of each that has not ended.
        """
        self.evaluations = self.evaluations + (self.codes == 0) if evaluations is None else evaluations
        self._rounds += 1
        self._lowest = self._xp.fmin(self._lowest, values)
        self._recent[self._rounds % (WINDOW + 1)] = self._lowest
        self._history.add(self.evaluations, self.index, values)
        if self.watch is not None:
            self.watch(self.index, torch.as_tensor(self.evaluations))

    @np.errstate(invalid="ignore")  # a value that has been infinite all the time has not fallen
    def slow(self, tolerance: float) -> Numbers:
        """Whether the lowest value fell by less than a share of itself in the last 20 rounds, (A,)."""
        before = self._recent[(self._rounds + 1) % (WINDOW + 1)]
        return before - self._lowest < tolerance * self._lowest

    def end(self, holds: Mapping[StopReason, Numbers]) -> None:
        """Ends those that run and for which a reason holds, (A,) each; of several the first counts."""
        for reason, mask in holds.items():
            if may_hold(mask):
                self.codes = self._xp.where((self.codes == 0) & mask, _CODES[reason], self.codes)

    def look(self, x: Tensor, values: Numbers) -> Tensor | None:
        """On a device now and then: as :meth:`drop`, if problems have ended."""
        if may_hold(self.codes) if self.at_once else self._rounds % ROUNDS_BETWEEN_LOOKS == 0:
            (codes,) = self.read()
            if codes.any():
                return self.drop(codes, x, values)
        return None

    def read(self, *masks: Tensor) -> list[Tensor]:
        """Why they have ended, or 0, and further ``masks`` (A,), all as int8 on the CPU; waits for the device once."""
        codes = torch.as_tensor(self.codes)
        return list(torch.stack([codes, *(mask.to(codes.dtype) for mask in masks)]).cpu())

    def drop(self, codes: Tensor, x: Tensor, values: Numbers) -> Tensor:
        """Drops those that have ended by ``codes`` (A,), as read; their points and values (A, N), (A,) are results.

        Returns:
            The rows (A',) of the others, on the CPU.  The last fill the gaps, so that few move.
        """
        ended = codes != 0
        self._enter(ended.nonzero().squeeze(1), codes, x, values)
        count = len(ended) - int(ended.sum())
        others = torch.arange(count)
        others[ended[:count]] = count + (~ended[count:]).nonzero().squeeze(1)
        self._problems = self._problems[others]
        self.index, self.codes, self.evaluations = (
            of_rows(each, others) for each in (self.index, self.codes, self.evaluations)
        )
        self._lowest, self._recent = of_rows(self._lowest, others), of_rows(self._recent.T, others).T
        return others

    def minimum(self, x: Tensor, values: Numbers) -> Minimum:
        """The outcome, once those that still run are at points ``x`` (A, N) with ``values`` (A,)."""
        self._enter(torch.arange(len(self._problems)), self.read()[0], x, values)
        history = self._history.filled(int(self._spent.max()))
        return Minimum(self._x, self._values, self._spent, self._reasons, history)

    def _enter(self, rows: Tensor, codes: Tensor, x: Tensor, values: Numbers) -> None:
        """Points and values of some rows (A',), on the CPU, are results."""
        for problem, code in zip(self._problems[rows].tolist(), codes[rows].tolist(), strict=True):
            if code:
                self._reasons[problem] = _REASONS[code - 1]
        rows = rows.to(self.index.device)
        index = self.index[rows]
        self._x[index], self._values[index] = x[rows], torch.as_tensor(values)[rows]
        self._spent[index] = torch.as_tensor(self.evaluations)[rows]
