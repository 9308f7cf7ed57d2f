"""A campaign of many cases against one target, which goes on after a fault and counts the faults by kind.

A *target* is a module of this folder with ``cases``, a hypothesis strategy, and ``check``, a function of one case that
raises :class:`Fault` if the package does anything but work or refuse in one clear sentence.
"""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy

Case = TypeVar("Case")
Kind = Literal["crashed", "hung", "wrong", "unclear"]
KINDS: tuple[Kind, ...] = ("crashed", "hung", "wrong", "unclear")
LONGEST_MESSAGE = 1000  # characters of a clear sentence


class Fault(Exception):
    """What went wrong with a case.

    Attributes:
        kind: ``crashed`` (a traceback or the end of the process), ``hung`` (longer or larger than the limits),
            ``wrong`` (a silently wrong result) or ``unclear`` (a refusal that is not one clear sentence).
    """

    def __init__(self, kind: Kind, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass
class Report:
    """What a campaign saw.

    Attributes:
        cases: number of cases.
        outcomes: how many cases ended in which way, by the words that ``check`` returned.
        faults: kind, message and case of each fault.
        seconds: wall time.
    """

    cases: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[tuple[Kind, str, Any]] = field(default_factory=list)
    seconds: float = 0.0


def check_sentence(message: str) -> None:
    """Raises Fault unless a refusal is one printable sentence of sensible length."""
    if not message.strip():
        raise Fault("unclear", "refused without a word")
    if len(message) > LONGEST_MESSAGE:
        raise Fault("unclear", f"refused in {len(message):,} characters: {message[:200]!r} …")
    if "Traceback" in message or not message.isprintable():
        raise Fault("unclear", f"refused with {message[:300]!r}")


def campaign(
    check: Callable[[Case], str],
    cases: SearchStrategy[Case],
    count: int,
    number: int,
    shown: Callable[[Report], None] = lambda report: None,
) -> Report:
    """Checks ``count`` random cases.

    Args:
        check: of one case; returns a word for what happened, such as ``worked`` or ``refused``.
        cases: where they come from.
        count: how many.
        number: the seed; the same seed gives the same cases.
        shown: called after each case.
    """
    report, began = Report(), time.monotonic()

    @seed(number)
    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(cases)
    def run(case: Case) -> None:
        report.cases += 1
        try:
            report.outcomes[check(case)] += 1
        except Fault as fault:
            report.faults.append((fault.kind, str(fault), case))
        except Exception:
            report.faults.append(("crashed", traceback.format_exc(limit=-3), case))
        report.seconds = time.monotonic() - began
        shown(report)

    run()
    return report
