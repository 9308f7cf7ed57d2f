"""What the tests of the command share."""

from __future__ import annotations

import os
from pathlib import Path

from skimage import data

SMALL = ["--quality", "fast", "--size", "40"]
FAST = [*SMALL, "--preset", "paper", "--prior", "none"]
CHELSEA = data.chelsea()[40:280:4, 60:380:4]


def names(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))
