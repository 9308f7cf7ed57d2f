"""The option ``--prior`` of commands that search for pre-images."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path

from ...evaluate.learned import load
from ...hog import HOGSpec
from ...invert import LearnedPrior
from ..errors import as_user_error


def prior_for(arguments: Namespace, uses: Iterable[tuple[str, HOGSpec | None]]) -> LearnedPrior | None:
    """The prior asked for, if any, once it fits all ``uses``: what it is for, and the spec of its descriptors.

    Raises:
        UserError: it cannot be read, or fits one of ``uses`` not.
    """
    if arguments.prior is None:
        return None
    with as_user_error():
        prior: LearnedPrior = load("prior", Path(arguments.prior))
    for name, spec in uses:
        with as_user_error(f"{name}: "):
            prior.check(spec or prior.spec)
    return prior
