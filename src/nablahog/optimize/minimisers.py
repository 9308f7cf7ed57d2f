"""The minimisers by name, written by `make generated`: functions here that return a Minimum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

from .dogleg import dogleg
from .lbfgs import lbfgs
from .problems import Minimum

Minimiser: TypeAlias = Literal["dogleg", "lbfgs"]
MINIMISERS: dict[Minimiser, Callable[..., Minimum]] = {"dogleg": dogleg, "lbfgs": lbfgs}
