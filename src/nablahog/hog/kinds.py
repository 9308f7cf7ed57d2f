"""Parts of a spec by the name of their kind, under which JSON has them."""

from __future__ import annotations

from typing import TypeVar

Part = TypeVar("Part")


def register(part: type[Part], kinds: dict[str, type[Part]]) -> None:
    """Adds the class of a part to those of its sort, if it defines its ``kind``, and not one that inherits it.

    Raises:
        TypeError: another part has this kind.
    """
    if "kind" not in vars(part):
        return
    kind: str = vars(part)["kind"]
    known = kinds.setdefault(kind, part)
    # a class may come again: from a module that is reloaded, or a dataclass with slots
    if (known.__module__, known.__qualname__) != (part.__module__, part.__qualname__):
        raise TypeError(f"the kind {kind!r} of {part.__qualname__} is that of {known.__qualname__}: choose another")
    kinds[kind] = part
