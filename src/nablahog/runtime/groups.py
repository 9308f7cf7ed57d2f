"""Items in groups that fit in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")


def split_by_weight(
    items: Iterable[T], weigh: Callable[[T], int], *, most: int, count: int | None = None
) -> Iterator[list[T]]:
    """Splits items, in their order, into groups of at most ``count`` items and a weight of at most ``most``.

    An item that is heavier is a group of its own.

    >>> from nablahog.runtime.groups import split_by_weight
    >>> list(split_by_weight([3, 1, 2, 9, 1, 1, 1], int, most=4, count=2))
    [[3, 1], [2], [9], [1, 1], [1]]
    """
    group: list[T] = []
    total = 0
    for item in items:
        weight = weigh(item)
        if group and (len(group) == count or total + weight > most):
            yield group
            group, total = [], 0
        group.append(item)
        total += weight
    if group:
        yield group
