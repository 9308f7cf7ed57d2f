"""The minimisers by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

from .dogleg import dogleg
from .lbfgs import lbfgs
from .problems import Minimum

Minimiser: TypeAlias = Literal["lbfgs", "dogleg"]
MINIMISERS: dict[Minimiser, Callable[..., Minimum]] = {"lbfgs": lbfgs, "dogleg": dogleg}
