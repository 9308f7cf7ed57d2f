"""The learned prior that the option ``--prior`` chooses."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

from ...hog import HOGSpec
from ...invert.learned import LearnedPrior, PriorChoice, default_prior_file, default_priors
from ...paper.learned import load
from ..errors import as_user_error
from ..terminal import inform

NO_PRIOR = "none"


@dataclass
class PriorOptions:
    """Which prior descriptors are inverted with.

    Attributes:
        learned: the prior in the file of ``--prior``; None without a file.
        default: whether the priors that come with the package are used.
    """

    learned: LearnedPrior | None
    default: bool

    @classmethod
    def of(cls, arguments: Namespace) -> PriorOptions:
        """By the option ``--prior``."""
        if arguments.prior in (None, NO_PRIOR):
            return cls(None, arguments.prior is None)
        with as_user_error():
            return cls(load("prior", Path(arguments.prior)), False)

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if the prior in the file is not for descriptors of ``spec``."""
        if self.learned is not None:
            self.learned.check(spec)

    def for_spec(self, spec: HOGSpec) -> PriorChoice:
        """The priors for descriptors of ``spec``; a line on stderr if the package's were not installed."""
        if not self.default or default_prior_file(spec) is None:
            return self.learned
        try:
            return default_priors(spec)
        except FileNotFoundError as error:
            self.default = False  # said once
            inform(f"Inverting without a learned prior: {error}")
            return None
