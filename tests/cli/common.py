"""What the tests of the command share."""

from __future__ import annotations

import os
from pathlib import Path

from skimage import data

SMALL = ["--max-evaluations", "3", "--size", "48"]
FAST = [*SMALL, "--descriptor", "paper"]  # inverting UoCTTI starts with a search for the histograms
CHELSEA = data.chelsea()[40:280:4, 60:380:4]


def names(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))
