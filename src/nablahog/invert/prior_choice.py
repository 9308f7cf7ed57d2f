"""The learned priors that come with the package: see default_priors/README.md."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Literal, TypeAlias

from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .histograms import searchable
from .learned import LearnedPrior

FOLDER = Path(__file__).with_name("default_priors")
PriorChoice: TypeAlias = LearnedPrior | Literal["default"] | None
"""A prior, the one that comes with the package, or none."""


def default_prior_file(spec: HOGSpec | str) -> Path | None:
    """The file of the prior that comes with the package for descriptors of ``spec``; None for those without one.

    Raises:
        ValueError: there is no such preset.
    """
    try:
        signed = searchable(as_spec(spec)).signed
    except ValueError:  # no image of such a descriptor can be sought
        signed = True
    return None if signed else FOLDER / "unsigned.npz"


def default_prior(spec: HOGSpec | str) -> LearnedPrior:
    """The prior that comes with the package for descriptors of ``spec``.

    Raises:
        ValueError: there is no such preset, or no prior for it.
        FileNotFoundError: the package was installed without its priors.
    """
    spec = as_spec(spec)
    file = default_prior_file(spec)
    if file is None:
        raise ValueError(f"no prior for {spec.named} descriptor comes with the package: give one, or none")
    return _load(file)


def as_prior(prior: PriorChoice, spec: HOGSpec) -> LearnedPrior | None:
    """The prior that is meant for descriptors of ``spec``.

    Raises:
        TypeError: it is no prior.
        ValueError, FileNotFoundError: as :func:`default_prior`.
    """
    if prior is None or isinstance(prior, LearnedPrior):
        return prior
    if prior == "default":
        return default_prior(spec)
    raise TypeError(f"prior must be a LearnedPrior, 'default' or None, got {prior!r}")


@lru_cache(maxsize=2)
def _load(file: Path) -> LearnedPrior:
    if not file.exists():
        raise FileNotFoundError(
            f"this installation of nablahog has no {file.name}, the prior for {file.stem} descriptors: install a wheel "
            "that has it, learn one (nablahog learn prior), or do without (prior=None, --no-prior)"
        )
    return LearnedPrior.load(file)
