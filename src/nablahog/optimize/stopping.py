"""When a search stops: the reasons of a batch, and the phases and rules of the dogleg."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from .result import StopReason


def enter_reasons(reasons: list[StopReason], problems: Tensor, holds: Mapping[StopReason, Tensor]) -> None:
    """Sets the reasons of those ``problems`` (A,) for which one holds, (A,) each; of several the first counts."""
    for reason, mask in reversed(list(holds.items())):
        for problem in problems[mask.to(problems.device)].tolist():
            reasons[problem] = reason


class Phases:
    """Which problems look for a Gauss-Newton step (``solving``), and which have one to try (``trying``).

    The others have stopped; ``reasons`` says why.
    """

    def __init__(self, like: Tensor) -> None:
        self.solving = torch.ones(len(like), dtype=torch.bool, device=like.device)
        self.trying = torch.zeros_like(self.solving)
        self.reasons = [StopReason.BUDGET] * len(like)

    def running(self) -> bool:
        return bool((self.solving | self.trying).any())

    def try_step(self, rows: Tensor, mask: Tensor) -> None:
        """Those of ``rows`` (A,) for which ``mask`` (A,) holds have their step, unless they have stopped."""
        rows = rows[mask & self.solving[rows]]
        self.solving[rows], self.trying[rows] = False, True

    def solve(self, rows: Tensor) -> None:
        """The problems ``rows`` (A,) look for their next step."""
        self.solving[rows], self.trying[rows] = True, False

    def stop(self, rows: Tensor, holds: Mapping[StopReason, Tensor]) -> None:
        """Stops those of ``rows`` (A,) for which a reason holds, (A,) each, unless they have stopped before."""
        for reason, mask in holds.items():
            stopped = rows[mask & (self.solving[rows] | self.trying[rows])]
            self.solving[stopped] = self.trying[stopped] = False
            for problem in stopped.tolist():
                self.reasons[problem] = reason


@dataclass(frozen=True)
class DoglegRules:
    """Limits and tolerances, as :func:`.dogleg.dogleg` has them."""

    max_evaluations: int
    max_iterations: int
    gradient_tolerance: float
    step_tolerance: float
    progress_tolerance: float
    cg_iterations: int
    cg_tolerance: float
