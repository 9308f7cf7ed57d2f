"""From descriptors and templates back to images."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch

import nablahog
from nablahog import LearnedPrior, invert
from nablahog.invert import AsPublished, Objective, Search
from nablahog.invert.prior.signed_network import Architecture

from ..table import Use, column
from .plain import DESCRIPTOR, IMAGE, SIZE, SMALL, UNSIGNED, angle, image, name, number, size

FEW = Search(max_evaluations=4, samples=1)
QUICK = AsPublished(iterations=1, max_evaluations=3)
LOOSE = 0.02  # searches amplify roundings


def inverted(d: Any, spec: Any = "uoctti", image_size: Any = SIZE, **more: Any) -> Any:
    settings: dict[str, Any] = {"prior": None, "search": FEW, **more}
    return nablahog.reconstruct(d, spec, image_size, **settings).image


def published(d: Any, spec: Any = "uoctti", image_size: Any = SIZE, seed: Any = 0) -> Any:
    """By the paper's search, which is quick."""
    return nablahog.reconstruct(d, spec, image_size, method=QUICK, seed=seed).image


def by_levels(d: Any, spec: Any = "uoctti", image_size: Any = SIZE, seed: Any = 0, **more: Any) -> Any:
    how = more or {"method": QUICK}
    levels = nablahog.reconstruct_multiscale(d, spec, image_size, scales=(4, 1), seed=seed, **how)
    return [level.reconstruction.image for level in levels]


@lru_cache
def prior() -> LearnedPrior:
    return nablahog.train_prior(
        {"a": torch.from_numpy(IMAGE)}, "paper", epochs=1, architecture=Architecture((8,) * 3, (0,) * 3)
    )


def drawn(d: Any, spec: Any = "paper", image_size: Any = SIZE, count: Any = 2) -> Any:
    search = Search(max_evaluations=4)
    return invert.reconstruct_samples(d, spec, image_size, count=count, prior=prior(), search=search).image


def trained(x: Any, spec: Any = "uoctti", epochs: Any = 1) -> Any:
    small = Architecture((8,) * 3, (0,) * 3)
    return nablahog.train_prior({"a": x}, spec, epochs=epochs, architecture=small).weights


COLUMNS = [
    column(
        "reconstruct",
        descriptor=Use(inverted, DESCRIPTOR),
        batch=Use(lambda x: inverted(DESCRIPTOR, start=x), SMALL),
        image=Use(
            lambda x: inverted(DESCRIPTOR[:1], expected=x, search=Search(max_evaluations=4)),
            SMALL[0, 0].numpy(),
            lambda x: np.asarray(x, np.float32),
        ),
        size=size(lambda s: published(DESCRIPTOR, image_size=s)),
        number=number(lambda n: published(DESCRIPTOR, seed=n), 3),
        name=name(lambda n: published(DESCRIPTOR, n)),
        tolerance=LOOSE,
    ),
    column(
        "Search",
        number=number(lambda n: inverted(DESCRIPTOR, search=Search(max_evaluations=n, samples=1)), 4),
        tolerance=LOOSE,
    ),
    column(
        "Objective",
        angle=angle(lambda a: inverted(DESCRIPTOR, objective=Objective(smoothness=a)), 1.0),
        tolerance=LOOSE,
    ),
    column(
        "reconstruct_multiscale",
        context=Use(lambda d: by_levels(d, prior=None, search=FEW), DESCRIPTOR),
        descriptor=Use(by_levels, DESCRIPTOR),
        size=size(lambda s: by_levels(DESCRIPTOR, image_size=s)),
        number=number(lambda n: by_levels(DESCRIPTOR, seed=n), 3),
        name=name(lambda n: by_levels(DESCRIPTOR, n)),
        tolerance=LOOSE,
    ),
    column(
        "samples",
        descriptor=Use(drawn, UNSIGNED),
        size=size(lambda s: drawn(UNSIGNED, image_size=s)),
        number=number(lambda n: drawn(UNSIGNED, count=n), 2),
        tolerance=LOOSE,
        types=(torch.Tensor,),
    ),
    column(
        "template_descriptor",
        descriptor=Use(lambda d: nablahog.template_descriptor(d, "uoctti", SIZE), DESCRIPTOR - 0.05),
        size=size(lambda s: nablahog.template_descriptor(DESCRIPTOR, "uoctti", s)),
        name=name(lambda n: nablahog.template_descriptor(DESCRIPTOR, n)),
    ),
    column(
        "train_prior",
        image=image(trained, lambda x: torch.from_numpy(np.asarray(x, np.float32))),
        number=number(lambda n: trained(torch.from_numpy(IMAGE), epochs=n), 1),
        name=name(lambda n: trained(torch.from_numpy(IMAGE), n)),
        tolerance=1e-3,
        types=(torch.Tensor,),
    ),
]
