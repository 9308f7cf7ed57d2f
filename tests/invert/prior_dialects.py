"""Dialects that learned priors are tested with."""

from __future__ import annotations

from dataclasses import replace

import pytest

from nablahog import presets
from nablahog.invert import Search

UOCTTI, PAPER = presets.uoctti(8), presets.paper(8)
SIGNED = {
    "uoctti": UOCTTI,
    "hard votes": presets.vlfeat(),
    "twelve bins, other sense": replace(UOCTTI, bins=12, counterclockwise=True),
    "dpm": presets.dpm(),
    "opencv, signed": presets.opencv((128, 128), nbins=18, signed=True),
}
UNSIGNED = {
    "paper": PAPER,
    "bins on the axes": replace(PAPER, bin_offset=0.0),
    "six bins, other sense": replace(PAPER, bins=6, counterclockwise=True),
    "opencv": presets.opencv(),
    "aubry": presets.aubry(8),
}
FEW = Search(max_evaluations=4)
signed_and_unsigned = pytest.mark.parametrize("spec", [UOCTTI, PAPER], ids=["signed", "unsigned"])
every_dialect = pytest.mark.parametrize("spec", [*SIGNED.values(), *UNSIGNED.values()], ids=[*SIGNED, *UNSIGNED])
