"""The options of a reconstruction: how much to spend, how to search, what to minimise, and the paper's own search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..hog.checks import check_choice
from ..optimize import Minimiser
from .choices import InversionMethod, QualityName
from .priors import Prior


class Quality(NamedTuple):
    """The budget of a search.

    Attributes:
        evaluations: of the operator, where several samples are drawn.
        without_samples: of the operator, where none are drawn.
        samples: images with the same histograms, whose mean is the expected image.
        on_histograms: evaluations of the normaliser alone, to invert it; they cost time per cell, not per pixel.
    """

    evaluations: int
    without_samples: int
    samples: int
    on_histograms: int


QUALITIES: dict[QualityName, Quality] = {
    "best": Quality(evaluations=660, without_samples=480, samples=4, on_histograms=200),
    "fast": Quality(evaluations=80, without_samples=80, samples=2, on_histograms=60),
}


def quality_of(name: QualityName) -> Quality:
    """The budget of that name.

    Raises:
        ValueError: there is no quality of that name.
    """
    check_choice("quality", name, QualityName)
    return QUALITIES[name]


@dataclass(frozen=True)
class Search:
    """How a pre-image is searched.

    Attributes:
        minimiser: ``"lbfgs"`` or ``"dogleg"`` (the paper's).
        max_evaluations: operator evaluations per image, at least 2; by default those of the quality: 660 where several
            samples are drawn, else 480; or 80.
        samples: images whose mean is the expected image, at least 1; by default those of the quality, 4 or 2.  They are
            drawn for signed descriptors, or where a start is given; fewer if each would get less than 28 evaluations.
            A single one is only a start: nothing is expected.

    Raises:
        ValueError: one is out of range.

    >>> from nablahog.invert import Search
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), "uoctti")
    >>> nablahog.reconstruct(descriptor, "uoctti", search=Search(max_evaluations=30, samples=1)).image.shape
    torch.Size([1, 1, 32, 32])
    """

    minimiser: Minimiser = "lbfgs"
    max_evaluations: int | None = None
    samples: int | None = None

    def __post_init__(self) -> None:
        check_choice("minimiser", self.minimiser, Minimiser)
        if self.max_evaluations is not None and self.max_evaluations < 2:
            raise ValueError(f"max_evaluations must be at least 2, one for each objective, got {self.max_evaluations}")
        if self.samples is not None and self.samples < 1:
            raise ValueError(f"samples must be at least 1, got {self.samples}")


@dataclass(frozen=True)
class Objective:
    """What is added to the relative distance of the descriptors, Eq. 8-9.

    Attributes:
        smoothness: ξ of Eq. 9, on the scale of the distance, see :func:`.priors.smoothness`.
        closeness: λ of :class:`.objective.PreimageObjective`, the weight of the distance to the expected image; by
            default 1 for signed dialects and for details, 3 for signed dialects with a learned prior, 0.1 for unsigned
            ones, whose region signs are uncertain.
        priors: further terms; with ``smoothness=0`` they replace the smoothness.

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


@dataclass(frozen=True)
class AsPublished:
    """The paper's own search: gray values as unknowns, noise as the start, and Powell's dogleg by Chumpy's rules.

    It minimises ‖φ(I) - φ(Î)‖² + ξ² Σ (i_p - i_q)² over the four neighbours of each pixel: the residuals φ(I) - φ(Î)
    and ξ (i_p - i_q) of Eq. 9, squared, as a dogleg does.

    Attributes:
        smoothness: ξ, for gray values in 0…1, "usually set to a big number as 1e2".  By default 100 where the
            descriptor leaves the contrast open: the image's contrast then shrinks until the smoothness, as it "will
            only play a key role in the first few iterations", hardly counts.  A descriptor that fixes the contrast
            would lose to it: there the default is 0.3.
        iterations: accepted steps, at most; a quarter of them at each level before the last of a multi-scale
            reconstruction, "few iterations".
        max_evaluations: operator evaluations per image, and per level, at least 2; by default all that the iterations
            take.  A product with the Jacobian or its transpose counts as half of one.
        keep_iterates: whether the image after each iteration is returned, too.

    Raises:
        ValueError: one is out of range.

    >>> from nablahog.invert import AsPublished
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 16, 16), "uoctti")
    >>> nablahog.reconstruct(descriptor, "uoctti", method=AsPublished(iterations=2)).image.shape
    torch.Size([1, 1, 16, 16])
    """

    smoothness: float | None = None
    iterations: int = 40
    max_evaluations: int | None = None
    keep_iterates: bool = False

    def __post_init__(self) -> None:
        if self.smoothness is not None and not 0 < self.smoothness < float("inf"):
            raise ValueError(f"smoothness must be a finite number above 0, got {self.smoothness}")
        if self.iterations < 1:
            raise ValueError(f"iterations must be at least 1, got {self.iterations}")
        if self.max_evaluations is not None and self.max_evaluations < 2:
            raise ValueError(f"max_evaluations must be at least 2, got {self.max_evaluations}")


def as_published(method: InversionMethod | AsPublished, **options: tuple[object, object]) -> AsPublished | None:
    """The options of the paper's search; None for the default method.

    Args:
        method: of the reconstruction.
        options: those that only the default method takes: each value with its default.

    Raises:
        ValueError: there is no such method, or the paper's search is given an option of the default method.
    """
    if not isinstance(method, AsPublished):
        check_choice("method", method, InversionMethod)
        if method == "default":
            return None
        method = AsPublished()
    for name, (value, default) in options.items():
        if value is not default and value != default:
            raise ValueError(f"{name} is an option of the default method, the paper's search does not take it")
    return method
