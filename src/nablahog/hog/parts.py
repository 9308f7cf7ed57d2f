"""What normalisers and poolings have in common."""

from __future__ import annotations

from abc import ABC
from typing import Any, ClassVar

from ..inputs.numbers import convert_fields


class Part(ABC):
    """A step of a spec: a frozen dataclass of its constants, which are converted by their types.

    Classes are known by their ``kind``, which one that inherits from another may leave out.
    """

    kinds: ClassVar[dict[str, Any]]
    """The classes of all steps of this sort by their ``kind``."""
    kind: ClassVar[str]

    def __init_subclass__(cls) -> None:
        """Raises TypeError if another class has this kind."""
        if "kind" not in vars(cls):
            return
        known = cls.kinds.setdefault(cls.kind, cls)
        # a class may come again: from a module that is reloaded, or a dataclass with slots
        if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise TypeError(
                f"the kind {cls.kind!r} of {cls.__qualname__} is that of {known.__qualname__}: choose another"
            )
        cls.kinds[cls.kind] = cls

    def __post_init__(self) -> None:
        convert_fields(self)
