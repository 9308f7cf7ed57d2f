"""The names of options.  Importing this module does not load PyTorch, which would slow ``nablahog --help`` down."""

from __future__ import annotations

from typing import Literal, TypeAlias

QualityName: TypeAlias = Literal["best", "fast"]
InversionMethod: TypeAlias = Literal["default", "paper"]
