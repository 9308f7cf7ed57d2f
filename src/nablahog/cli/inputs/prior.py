"""The learned prior that the options ``--prior`` and ``--no-prior`` choose."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

from ...hog import HOGSpec
from ...invert.learned import LearnedPrior, PriorChoice, default_prior_file, default_priors
from ...paper.learned import load
from ..errors import as_user_error
from ..terminal import inform


@dataclass
class PriorOptions:
    """Which prior descriptors are inverted with.

    Attributes:
        given: the prior of ``--prior``, for all descriptors; None if there is none.
        default: whether the priors that come with the package are used, for the descriptors that there is one for.
    """

    given: LearnedPrior | None
    default: bool

    @classmethod
    def of(cls, arguments: Namespace) -> PriorOptions:
        """Those of a command.

        Raises:
            UserError: the file of ``--prior`` cannot be used.
        """
        if arguments.prior is None:
            return cls(None, not arguments.no_prior)
        with as_user_error():
            return cls(load("prior", Path(arguments.prior)), False)

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if the prior of ``--prior`` is not for descriptors of ``spec``."""
        if self.given is not None:
            self.given.check(spec)

    def for_spec(self, spec: HOGSpec) -> PriorChoice:
        """The priors for descriptors of ``spec``, if there are any; says so where they were not installed."""
        if not self.default or default_prior_file(spec) is None:
            return self.given
        try:
            return default_priors(spec)
        except FileNotFoundError as error:
            self.default = False  # said once
            inform(f"Inverting without a learned prior: {error}")
            return None
