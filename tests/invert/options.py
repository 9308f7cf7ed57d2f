"""Options of reconstruct by their own names."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from nablahog.invert import Objective, Search


def grouped(**options: Any) -> dict[str, Any]:
    """The same, those of a group as the group."""
    for group, kind in (("search", Search), ("objective", Objective)):
        own = {field.name: options.pop(field.name) for field in fields(kind) if field.name in options}
        options[group] = kind(**own)
    return options
