"""The learned priors that come with the package: see default_priors/README.md."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .histograms import searchable
from .learned import LearnedPrior

FOLDER = Path(__file__).with_name("default_priors")
PriorChoice: TypeAlias = LearnedPrior | Sequence[LearnedPrior] | Literal["default"] | None
"""A prior; one for unsigned descriptors and one for signed ones; those that come with the package; or none."""


def default_prior_file(spec: HOGSpec | str) -> Path | None:
    """The file of the prior that comes with the package for descriptors of ``spec``; None if none can be inverted.

    Raises:
        ValueError: there is no such preset.
    """
    try:
        signed = searchable(as_spec(spec)).signed
    except ValueError:  # no image of such a descriptor can be sought
        return None
    return FOLDER / ("signed.npz" if signed else "unsigned.npz")


def default_prior(spec: HOGSpec | str) -> LearnedPrior:
    """The prior that comes with the package for descriptors of ``spec``.

    Args:
        spec: the dialect, or the name of a preset with its defaults.

    Raises:
        ValueError: there is no such preset, or no prior for it.
        FileNotFoundError: the package was installed without its priors.

    >>> prior = nablahog.invert.default_prior("uoctti")
    >>> prior.signed
    True
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), "uoctti")
    >>> prior.expected(descriptor, nablahog.presets.uoctti(), (32, 32)).shape
    torch.Size([1, 1, 32, 32])
    """
    spec = as_spec(spec)
    file = default_prior_file(spec)
    if file is None:
        raise ValueError(f"no prior for {spec.named} descriptor comes with the package: give one, or none")
    return _load(file)


class Priors(NamedTuple):
    """Those that a reconstruction uses.

    Attributes:
        own: for its descriptors.
        details: if these are unsigned, one for signed descriptors, or None: once signs are found, it knows details.
    """

    own: LearnedPrior
    details: LearnedPrior | None = None


def as_priors(prior: PriorChoice, spec: HOGSpec) -> Priors | None:
    """The priors that are meant for descriptors of ``spec``.

    Raises:
        TypeError: they are none.
        ValueError, FileNotFoundError: as :func:`default_prior`; of several there is not one for such descriptors.
    """
    if prior is None:
        return None
    if isinstance(prior, LearnedPrior):
        return Priors(prior)
    if prior == "default":
        prior = default_priors(spec)
    if isinstance(prior, str) or not all(isinstance(each, LearnedPrior) for each in prior):
        raise TypeError(f"prior must be a LearnedPrior, a list of these, 'default' or None, got {prior!r}")
    signed = searchable(spec).signed
    by_signs = {each.signed: each for each in prior if isinstance(each, LearnedPrior)}
    if signed not in by_signs or len(by_signs) < len(prior):
        kind = "signed" if signed else "unsigned"
        raise ValueError(f"expected one prior for {kind} descriptors, and at most one for others, got {prior!r}")
    return Priors(by_signs[signed], None if signed else by_signs.get(True))


def default_priors(spec: HOGSpec | str) -> list[LearnedPrior]:
    """All priors that come with the package and help with descriptors of ``spec``.

    Raises:
        ValueError, FileNotFoundError: as :func:`default_prior`.
    """
    own = default_prior(spec)
    return [own] if own.signed else [own, default_prior("uoctti")]


@lru_cache(maxsize=2)
def _load(file: Path) -> LearnedPrior:
    if not file.exists():
        raise FileNotFoundError(
            f"this installation of nablahog has no {file.name}, the prior for {file.stem} descriptors: install a wheel "
            "that has it, learn one (nablahog learn prior), or do without (prior=None, --prior none)"
        )
    return LearnedPrior.load(file)
