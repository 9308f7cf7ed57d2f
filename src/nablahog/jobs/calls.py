"""``map`` on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from .resume import run_anywhere

R = TypeVar("R")


@dataclass(frozen=True, eq=False)
class Call(Generic[R]):
    """A function with its arguments, as work."""

    function: Callable[..., R]
    arguments: tuple[Any, ...]

    def run(self) -> R:
        """Calls it."""
        return self.function(*self.arguments)


def map_on(cluster: str) -> Callable[..., Iterator[Any]]:
    """``map`` on a cluster: yields the results in order.

    Args:
        cluster: as :func:`.cluster.run_on_cluster` names it.

    Returns:
        A function, which raises ValueError where a call fails, and whatever :func:`.resume.run_anywhere` does.
    """

    def mapped(function: Callable[..., R], *arguments: Iterable[Any]) -> Iterator[R]:
        calls = [Call(function, each) for each in zip(*arguments, strict=True)]
        early: dict[int, R] = {}
        wanted = 0
        with closing(run_anywhere(calls, 1, cluster)) as outcomes:
            for index, outcome in outcomes:
                if isinstance(outcome, str):
                    raise ValueError(outcome)
                early[index] = outcome
                while wanted in early:
                    yield early.pop(wanted)
                    wanted += 1

    return mapped
