"""Pairs of dictionaries, learned from little."""

from __future__ import annotations

from functools import cache

from torch import Tensor

from nablahog import presets
from nablahog.hog import HOGSpec
from nablahog.paper.baselines.hoggles import (
    PairedDictionary,
)
from nablahog.paper.baselines.hoggles_learning import learn_hoggles

from ...invert.photographs import photograph

SPEC = presets.uoctti(4)
NAMES = ("camera", "coins", "clock")


def images(*names: str) -> dict[str, Tensor]:
    return {name: photograph(64, name)[0, 0] for name in names or NAMES}


@cache
def learned() -> PairedDictionary:
    return learn_hoggles(images(), SPEC, atoms=40, iterations=8)


@cache
def fast(spec: HOGSpec = SPEC, atoms: int = 60) -> PairedDictionary:
    return learn_hoggles(images(), spec, atoms=atoms, fast=True)
