"""What a search for a pose can be asked for, by name."""

from __future__ import annotations

from typing import Literal, TypeAlias

Kind: TypeAlias = Literal["dot", "whitened", "calibrated"]  # of similarity
Search: TypeAlias = Literal["best", "paper", "exhaustive"]
ORDER = 9  # the largest offset in cells of a background: for templates of up to 10x10
