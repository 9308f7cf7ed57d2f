"""How a pre-image is searched: as by default, or as the paper does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from ..hog.checks import check_choice
from ..hog.spec import HOGSpec

InversionMethod: TypeAlias = Literal["default", "paper"]
Norms: TypeAlias = Literal["squared", "printed"]
Neighbours: TypeAlias = Literal[4, 8]
SMOOTHNESS = 100.0  # ξ of the paper


@dataclass(frozen=True)
class AsPublished:
    """The paper's own search, with a value for each thing that Section 3.1 leaves open.

    Unknowns are gray values, the search begins with noise, and the minimiser is Powell's dogleg by Chumpy's rules.

    Attributes:
        smoothness: ξ of Eq. 9, for gray values in 0…1, "usually set to a big number as 1e2"; several are its course,
            each minimised from where the one before ended.  None for 100 where the descriptor leaves the contrast open:
            the image's then shrinks until the smoothness, as it "will only play a key role in the first few
            iterations", hardly counts.  A descriptor that fixes the contrast would lose to it: there None is 0.3.
        norms: ``"squared"``: ‖φ(I) - φ(Î)‖² + ξ² Σ (i_p - i_q)², what a dogleg minimises that is given φ(I) - φ(Î) and
            ξ (i_p - i_q) as residuals; ``"printed"``: ‖φ(I) - φ(Î)‖ + ξ Σ |i_p - i_q|, letter by letter.
        neighbours: of a pixel, 4, or 8 with the diagonals, which count as much.
        noise: standard deviation of the start, in 0…1.  None for 1e-4 where the descriptor leaves the contrast open, so
            that the smoothness of the start weighs as much as its distance, and 0.01 where it does not.
        iterations: accepted steps, at most, for each ξ.
        level_iterations: the same at each level before the last of a multi-scale reconstruction, "few iterations".
        cg_tolerance: how far the equations of a Gauss-Newton step may be from solved, a share of their right side.
        cg_iterations: of conjugate gradients a step, at most.
        max_evaluations: operator evaluations an image may spend, at each level of a multi-scale one, at least 2; None
            for all that the iterations take.  A product with the Jacobian or its transpose is half of one.
        keep_iterates: whether the image after each iteration is returned, too.

    Raises:
        ValueError: one is out of range.

    >>> from nablahog.invert import AsPublished
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 16, 16), "uoctti")
    >>> nablahog.reconstruct(descriptor, "uoctti", method=AsPublished(iterations=2)).image.shape
    torch.Size([1, 1, 16, 16])
    """

    smoothness: float | Sequence[float] | None = None
    norms: Norms = "squared"
    neighbours: Neighbours = 4
    noise: float | None = None
    iterations: int = 40
    level_iterations: int = 10
    cg_tolerance: float = 1e-4
    cg_iterations: int = 200
    max_evaluations: int | None = None
    keep_iterates: bool = False

    def __post_init__(self) -> None:
        check_choice("norms", self.norms, Norms)
        check_choice("neighbours", self.neighbours, Neighbours)
        if not self.course or not all(0 < weight < float("inf") for weight in self.course):
            raise ValueError(f"smoothness must be a finite number above 0, or several, got {self.smoothness}")
        if self.noise is not None and not 0 < self.noise < float("inf"):
            raise ValueError(f"noise must be a finite number above 0, got {self.noise}")
        if not 0 < self.cg_tolerance < 1:
            raise ValueError(f"cg_tolerance must be between 0 and 1, got {self.cg_tolerance}")
        for name in ("iterations", "level_iterations", "cg_iterations"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.max_evaluations is not None and self.max_evaluations < 2:
            raise ValueError(f"max_evaluations must be at least 2, got {self.max_evaluations}")

    @property
    def course(self) -> tuple[float, ...]:
        """The values of ξ, one after the other."""
        if isinstance(self.smoothness, Sequence):
            return tuple(self.smoothness)
        return (SMOOTHNESS if self.smoothness is None else self.smoothness,)

    def for_spec(self, spec: HOGSpec) -> AsPublished:
        """The same without None."""
        fixed = spec.normalizer.fixes_contrast
        smoothness = (0.3 if fixed else SMOOTHNESS) if self.smoothness is None else self.smoothness
        noise = (1e-2 if fixed else 1e-4) if self.noise is None else self.noise
        return replace(self, smoothness=smoothness, noise=noise)


def as_published(method: InversionMethod | AsPublished) -> AsPublished | None:
    """The options of the paper's search, if it is asked for.

    Raises:
        ValueError: there is no such method.
    """
    if isinstance(method, AsPublished):
        return method
    check_choice("method", method, InversionMethod)
    return AsPublished() if method == "paper" else None


def check_default_only(**given: tuple[object, object]) -> None:
    """Raises ValueError for an option of the default method, a value with its default, that has another value."""
    for name, (value, default) in given.items():
        if value is not default and value != default:
            raise ValueError(f"{name} is an option of the default method, the paper's search does not take it")
