"""The options of a reconstruction in two groups: how to search, and what for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..hog.checks import check_choice
from ..optimize import Minimiser
from .priors import Prior

Basis: TypeAlias = Literal["cosine", "pixels"]


@dataclass(frozen=True)
class Search:
    """How a pre-image is searched.

    Attributes:
        minimiser: ``"lbfgs"`` or ``"dogleg"`` (the paper's).
        basis: the unknowns, ``"cosine"`` coefficients or, as in the paper, ``"pixels"``.
        max_evaluations: operator evaluations an image may spend, at least 2; None for those of the quality: 660 where
            several samples are drawn, else 480; or 80.
        samples: images whose mean is expected, at least 1; None for those of the quality, 4 or 2.  They are drawn of
            signed descriptors, or where a start is given; fewer if each could spend less than 28 evaluations.  A single
            one is where the descriptor itself is matched from, and nothing is expected.
        region_signs: whether an unsigned descriptor's regions get signs first.  If not, the search begins with noise,
            and nothing is expected.
        polarity: whether, of an unsigned descriptor's image and its negative, the likelier is returned.  If not, it is
            the one that the search ended with.

    Raises:
        ValueError: one is out of range.

    >>> from nablahog.invert import Search
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), "uoctti")
    >>> nablahog.reconstruct(descriptor, "uoctti", search=Search(max_evaluations=30, samples=1)).image.shape
    torch.Size([1, 1, 32, 32])
    """

    minimiser: Minimiser = "lbfgs"
    basis: Basis = "cosine"
    max_evaluations: int | None = None
    samples: int | None = None
    region_signs: bool = True
    polarity: bool = True

    def __post_init__(self) -> None:
        check_choice("minimiser", self.minimiser, Minimiser)
        check_choice("basis", self.basis, Basis)
        if self.max_evaluations is not None and self.max_evaluations < 2:
            raise ValueError(f"max_evaluations must be at least 2, one for each objective, got {self.max_evaluations}")
        if self.samples is not None and self.samples < 1:
            raise ValueError(f"samples must be at least 1, got {self.samples}")


@dataclass(frozen=True)
class Objective:
    """What is added to the relative distance of the descriptors, Eq. 8-9.

    Attributes:
        smoothness: ξ of Eq. 9, on the distance's own scale, see :func:`.priors.smoothness`.
        closeness: λ of :class:`.objective.PreimageObjective`, how strongly the image is kept at what is expected; None
            for 1 of signed specs and of details, 3 of signed specs with a learned prior, 0.1 of unsigned ones, whose
            region signs are uncertain.
        priors: added to the above; with ``smoothness=0``, instead of it.

    Raises:
        ValueError: a number is negative or not finite.
        TypeError: ``priors`` are no priors.

    >>> from nablahog.invert import Objective
    >>> from nablahog.invert.priors import TotalVariation
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), "uoctti")
    >>> objective = Objective(smoothness=0.1, priors=[TotalVariation(1e-3)])
    >>> nablahog.reconstruct(descriptor, "uoctti", objective=objective, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    """

    smoothness: float = 0.02
    closeness: float | None = None
    priors: Sequence[Prior] = ()

    def __post_init__(self) -> None:
        for name, value in (("smoothness", self.smoothness), ("closeness", self.closeness)):
            if value is not None and not 0 <= value < float("inf"):
                raise ValueError(f"{name} must be a finite number of at least 0, got {value}")
        if not isinstance(self.priors, Sequence) or not all(isinstance(prior, Prior) for prior in self.priors):
            raise TypeError(f"priors must be a list of priors, got {self.priors!r}")
        object.__setattr__(self, "priors", tuple(self.priors))
