"""The priors of a reconstruction: given ones, or those that come with the package."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from ...hog.dialects import as_spec
from ...hog.spec import HOGSpec
from ...inputs.numbers import shortened
from ..histograms import linear_vote_spec
from .learned import LearnedPrior

PRIOR_FOLDER = Path(__file__).with_name("default_priors")  # see its README.md

PriorChoice: TypeAlias = LearnedPrior | Sequence[LearnedPrior] | Literal["default"] | None
"""A prior; one for unsigned descriptors and one for signed ones; those that come with the package; or none."""


class Priors(NamedTuple):
    """The prior for a reconstruction's descriptors; if these are unsigned, also one for signed ones, for details."""

    prior: LearnedPrior
    details: LearnedPrior | None = None


def as_priors(prior: PriorChoice, spec: HOGSpec, *, by_default: bool = True) -> Priors | None:
    """The chosen priors for descriptors of ``spec``; ValueError if a list has none for these, or several.

    Without ``by_default``, "default" means none.
    """
    if isinstance(prior, str) and prior == "default":
        prior = default_priors(spec) if by_default else None
    if prior is None:
        return None
    if isinstance(prior, LearnedPrior):
        return Priors(prior)
    if not isinstance(prior, list | tuple) or not all(isinstance(item, LearnedPrior) for item in prior):
        raise TypeError(f"prior must be a LearnedPrior, a list of these, 'default' or None, got {shortened(prior)}")
    signed = linear_vote_spec(spec).signed
    by_signs = {item.signed: item for item in prior if isinstance(item, LearnedPrior)}
    if signed not in by_signs or len(by_signs) < len(prior):
        kind = "signed" if signed else "unsigned"
        raise ValueError(
            f"expected one prior for {kind} descriptors, and at most one for others, got {shortened(prior)}"
        )
    return Priors(by_signs[signed], None if signed else by_signs.get(True))


def default_prior_file(spec: HOGSpec | str) -> Path | None:
    """The file of the package's prior for descriptors of ``spec``; None if these cannot be inverted."""
    try:
        signed = linear_vote_spec(as_spec(spec)).signed
    except ValueError:
        return None
    return PRIOR_FOLDER / ("signed.npz" if signed else "unsigned.npz")


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
        raise ValueError(f"no prior for {spec.named} descriptor comes with the package: give another `prior`, or none")
    return _load(file)


def default_priors(spec: HOGSpec | str) -> list[LearnedPrior]:
    """The package's priors for descriptors of ``spec``: for unsigned ones also the signed prior, for details."""
    prior = default_prior(spec)
    return [prior] if prior.signed else [prior, _load(PRIOR_FOLDER / "signed.npz")]


@lru_cache(maxsize=2)  # they are parts of the package, and do not change
def _load(file: Path) -> LearnedPrior:
    if not file.exists():
        raise FileNotFoundError(
            f"this installation of nablahog has no {file.name}, the prior for {file.stem} descriptors: install a wheel "
            "that has it, learn one (nablahog learn prior), or do without (`prior` none)"
        )
    return LearnedPrior.load(file)
