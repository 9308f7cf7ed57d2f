"""Why problems of a batch have ended, kept on their device: to read it is to wait for the device.

On a CPU there is nothing to wait for, and a problem is dropped in the round in which it ends.  On a device a problem
that has ended stays as it is, by masks, and is evaluated again at its last point until the next look; only then the
numbers are read, once, and all that have ended are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from .result import StopReason

ROUNDS_BETWEEN_LOOKS = 10  # on a device: more waste evaluations of problems that have ended, fewer wait more often
_REASONS = tuple(StopReason)
_CODES = {reason: k + 1 for k, reason in enumerate(_REASONS)}


def dropped_at_once(like: Tensor) -> bool:
    """Whether problems with such unknowns are dropped in the round in which they end: nothing is waited for."""
    return like.device.type == "cpu"


def enter(codes: Tensor, holds: Mapping[StopReason, Tensor]) -> Tensor:
    """Which problems (A,) run, 0, or why they have ended, in int8.

    Args:
        codes: (A,), before.  A problem that has ended keeps its reason.
        holds: for each reason, whether it holds, (A,); of several the first counts.
    """
    new = torch.zeros_like(codes)
    for reason, mask in reversed(list(holds.items())):
        new.masked_fill_(mask, _CODES[reason])
    return torch.where(codes == 0, new, codes)


def read(codes: Tensor, problems: Tensor, reasons: list[StopReason]) -> Tensor:
    """Which problems have ended, (A,), on the CPU; waits for the device once.

    Args:
        codes: (A,), of :func:`enter`.
        problems: (A,), their indices, on the CPU.
        reasons: of all problems; those of the ended ones are set.
    """
    codes = codes.cpu()
    done = codes != 0
    if done.any():
        _set_reasons(codes[done], problems[done], reasons)
    return done


def _set_reasons(codes: Tensor, problems: Tensor, reasons: list[StopReason]) -> None:
    for problem, code in zip(problems.tolist(), codes.tolist(), strict=True):
        reasons[problem] = _REASONS[code - 1]
