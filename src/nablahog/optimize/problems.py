"""What a minimiser takes and returns, and the problems of a batch that still run.

On a CPU a problem is dropped in the round in which it ends.  To read a number from a device is to wait for it: there a
problem that has ended stays as it is, by masks, and is evaluated again at its last point until the next look; only then
the numbers are read, once, and all that have ended are dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import torch
from torch import Tensor

ObjectiveFunction: TypeAlias = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""(points (A, N), indices (A,) of their problems in the batch, all different) to (values (A,), gradients (A, N))."""

Numbers: TypeAlias = Any
"""A few numbers of each problem: a tensor, or an array of NumPy, whose operations take a quarter of the time."""

Watch: TypeAlias = Callable[[Tensor, Tensor], None]
"""Called after each call of the objective: the indices (A,) of its problems, and their evaluations (A,) so far.

On a GPU problems that have ended may be among them for some rounds, with the evaluations that they ended with.
"""

Accepted: TypeAlias = Callable[[Tensor, Tensor, Tensor], None]
"""Called after accepted steps: the indices (A,) of the problems, their iterations (A,) so far, their points (A, N)."""


@runtime_checkable
class LeastSquares(Protocol):
    """An :data:`ObjectiveFunction` whose value is a sum of squares, and which tells them apart."""

    def __call__(self, points: Tensor, index: Tensor, /) -> tuple[Tensor, Tensor]: ...

    def residuals(self, points: Tensor, index: Tensor, /) -> Tensor:
        """Points (A, N) of the problems ``index`` (A,) to residuals (A, M) whose squares sum to the values.

        Row a depends on point a only.  Differentiable by PyTorch, and the derivative again (for J·v).
        """
        ...


class Jacobian(Protocol):
    """The Jacobians J of some problems of a batch, each at its point.

    Attributes:
        size: M, the number of residuals.
    """

    size: int

    def jvp(self, vectors: Tensor, /) -> Tensor:
        """J·v: (A, N) to (A, M)."""
        ...

    def vjp(self, vectors: Tensor, /) -> Tensor:
        """Jᵀ·v: (A, M) to (A, N)."""
        ...

    def precondition(self, vectors: Tensor, /) -> Tensor:
        """W⁻¹·v, (A, N), of a symmetric positive W near JᵀJ: the closer, the fewer products a step takes."""
        ...


@runtime_checkable
class Linearizable(LeastSquares, Protocol):
    """A problem that knows its Jacobian better than the graph of its residuals does."""

    def linearize(self, points: Tensor, index: Tensor, /) -> Jacobian:
        """J at the points (A, N) of the problems ``index`` (A,)."""
        ...


class StopReason(str, Enum):
    """Why a search ended.  A member prints as its sentence, and compares equal to it."""

    BUDGET = "evaluation budget spent"
    GRADIENT = "gradient below tolerance"
    PROGRESS = "progress below tolerance"
    LINE_SEARCH = "no lower point along the descent direction"
    STEP = "step below tolerance"
    RADIUS = "trust region collapsed"
    ITERATIONS = "iteration limit reached"
    NOT_FINITE = "no finite step from the derivatives"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Minimum:
    """Outcome of a batched minimisation.

    One evaluation is a value with its gradient.  Residuals alone, and a product of the Jacobian or its transpose with a
    vector, are half of one each, about their cost.

    Attributes:
        x: (B, N), the lowest point found for each problem.
        value: (B,), the objective there.
        evaluations: (B,) int64, how often each problem's objective was evaluated, halves rounded up.
        stop_reason: for each problem, why it stopped.
        history: (evaluations of the longest problem, B): the value of each problem's current point after each
            evaluation; a problem that has stopped repeats its last value.
    """

    x: Tensor
    value: Tensor
    evaluations: Tensor
    stop_reason: list[StopReason]
    history: Tensor


class History:
    """Collects one number a problem and evaluation, where problems spend their evaluations at different times."""

    def __init__(self, batch: int) -> None:
        self._batch = batch
        self._added: list[tuple[Numbers, Tensor, Numbers]] = []

    def add(self, evaluations: Numbers, index: Tensor, numbers: Numbers) -> None:
        """The problems ``index`` have ``numbers`` after ``evaluations``, (A,) each, which are kept; 0 adds none."""
        self._added.append((evaluations, index, numbers))

    def fill(self, length: int) -> Tensor:
        """(length, B): where a problem has no number it repeats its last.  Each has one after its first evaluation."""
        evaluations, index, numbers = (
            torch.cat([torch.as_tensor(part) for part in parts]) for parts in zip(*self._added, strict=True)
        )
        most = max(length, int(evaluations.max()))
        table = numbers.new_zeros(most + 1, self._batch)
        last = torch.zeros_like(table, dtype=torch.long)
        table[evaluations, index], last[evaluations, index] = numbers, evaluations
        return table.gather(0, last[1 : length + 1].cummax(dim=0).values)


PROGRESS_WINDOW = 20  # evaluations over which progress is judged
ROUNDS_BETWEEN_LOOKS = 10  # on a device: more waste evaluations of problems that have ended, fewer wait more often
_STOP_REASONS = tuple(StopReason)
_STOP_CODES = {reason: k + 1 for k, reason in enumerate(_STOP_REASONS)}


def dropped_at_once(like: Tensor) -> bool:
    """Whether problems with such unknowns are dropped in the round in which they end: nothing is waited for."""
    return like.device.type == "cpu"


def as_numbers(tensor: Tensor) -> Numbers:
    """The tensor, on a CPU as a NumPy array."""
    return tensor.numpy() if dropped_at_once(tensor) else tensor


def array_namespace(numbers: Numbers) -> ModuleType:
    """NumPy or PyTorch: their functions of one name do the same, as the array API standard says."""
    return np if isinstance(numbers, np.ndarray) else torch


def select_rows(numbers: Numbers, rows: Tensor) -> Numbers:
    """Some rows (A',), given on the CPU, of numbers (A, …)."""
    return numbers[rows.to(numbers.device, non_blocking=True) if isinstance(numbers, Tensor) else rows.numpy()]


def possibly_any(mask: Numbers) -> bool:
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
        self._recent = self._xp.stack([self._xp.full_like(values, np.inf)] * (PROGRESS_WINDOW + 1))
        self._history = History(len(start))
        self._x, self._values = torch.empty_like(start), start.new_empty(len(start))
        self._spent, self._reasons = torch.zeros_like(self.index), [StopReason.BUDGET] * len(start)
        self.count(values)

    def count(self, values: Numbers, evaluations: Numbers | None = None) -> None:
        """They have been evaluated, by default once more where they run; the objective has the ``values`` (A,)."""
        self.evaluations = self.evaluations + (self.codes == 0) if evaluations is None else evaluations
        self._rounds += 1
        self._lowest = self._xp.fmin(self._lowest, values)
        self._recent[self._rounds % (PROGRESS_WINDOW + 1)] = self._lowest
        self._history.add(self.evaluations, self.index, values)
        if self.watch is not None:
            self.watch(self.index, torch.as_tensor(self.evaluations))

    @np.errstate(invalid="ignore")  # a value that has been infinite all the time has not fallen
    def find_stalled(self, tolerance: float) -> Numbers:
        """Whether the lowest value fell by less than a share of itself in the last 20 rounds, (A,)."""
        before = self._recent[(self._rounds + 1) % (PROGRESS_WINDOW + 1)]
        return before - self._lowest < tolerance * self._lowest

    def end(self, holds: Mapping[StopReason, Numbers]) -> None:
        """Ends those that run and for which a reason holds, (A,) each; of several the first counts."""
        for reason, mask in holds.items():
            if possibly_any(mask):
                self.codes = self._xp.where((self.codes == 0) & mask, _STOP_CODES[reason], self.codes)

    def look(self, x: Tensor, values: Numbers) -> Tensor | None:
        """On a device, every few rounds: drops problems that have ended, as :meth:`drop`."""
        if possibly_any(self.codes) if self.at_once else self._rounds % ROUNDS_BETWEEN_LOOKS == 0:
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

        Returns the rows (A',) of the others, on the CPU.  The last fill the gaps, so that few move.
        """
        ended = codes != 0
        self._enter(ended.nonzero().squeeze(1), codes, x, values)
        count = len(ended) - int(ended.sum())
        running = torch.arange(count)
        running[ended[:count]] = count + (~ended[count:]).nonzero().squeeze(1)
        self._problems = self._problems[running]
        self.index, self.codes, self.evaluations = (
            select_rows(numbers, running) for numbers in (self.index, self.codes, self.evaluations)
        )
        self._lowest, self._recent = select_rows(self._lowest, running), select_rows(self._recent.T, running).T
        return running

    def minimum(self, x: Tensor, values: Numbers) -> Minimum:
        """The outcome, once those that still run are at points ``x`` (A, N) with ``values`` (A,)."""
        self._enter(torch.arange(len(self._problems)), self.read()[0], x, values)
        history = self._history.fill(int(self._spent.max()))
        return Minimum(self._x, self._values, self._spent, self._reasons, history)

    def _enter(self, rows: Tensor, codes: Tensor, x: Tensor, values: Numbers) -> None:
        """Points and values of some rows (A',), on the CPU, are results."""
        for problem, code in zip(self._problems[rows].tolist(), codes[rows].tolist(), strict=True):
            if code:
                self._reasons[problem] = _STOP_REASONS[code - 1]
        rows = rows.to(self.index.device, non_blocking=True)
        index = self.index[rows]
        self._x[index], self._values[index] = x[rows], torch.as_tensor(values)[rows]
        self._spent[index] = torch.as_tensor(self.evaluations)[rows]
