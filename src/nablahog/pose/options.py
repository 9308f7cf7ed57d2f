"""What a search for a pose can be asked for, by name."""

from __future__ import annotations

from typing import Literal, TypeAlias

SimilarityKind: TypeAlias = Literal["patches", "whitened", "calibrated"]
SearchMethod: TypeAlias = Literal["best", "paper", "paper-edges", "exhaustive"]
Ascent: TypeAlias = Literal["quadratic", "momentum", "lbfgs"]
FocalSource: TypeAlias = Literal["given", "exif", "assumed"]
ORDER = 9  # the largest offset in cells of a background: for templates of up to 10x10
