"""The options of a search for a pose, by name."""

from __future__ import annotations

from typing import Literal, TypeAlias

SimilarityKind: TypeAlias = Literal["patches", "calibrated"]
SearchMethod: TypeAlias = Literal["best", "paper", "paper-edges", "exhaustive"]
FocalSource: TypeAlias = Literal["given", "exif", "assumed"]
