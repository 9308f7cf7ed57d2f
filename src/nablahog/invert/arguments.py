"""The arguments of a reconstruction: checks of descriptors and images, and all options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from torch import Tensor

from ..hog.spec import HOGSpec
from ..inputs.arrays import LEVEL_OVERSHOOT, ArrayImage, as_unit_range, warn_about_levels
from ..inputs.numbers import as_integer, as_number, as_size, as_truth, check_choice, check_type
from ..inputs.tensors import check_finite, check_floats
from ..optimize import Minimiser
from .choices import InversionMethod, QualityName
from .prior.terms import Prior

MOST_SAMPLES = 10_000  # of a descriptor
LARGEST_ENTRY = 1e6  # far above any entry for an image, and small enough that its fourth power does not overflow


def check_axes(name: str, tensor: Tensor) -> None:
    """Raises ValueError unless ``tensor`` has the axes (B, rows, cols, channels), with B at least 1."""
    if tensor.dim() == 4 and len(tensor):
        return
    hints = {3: f": write {name.split()[-1]}[None]", 4: ""}
    hint = hints.get(tensor.dim(), "; nablahog.from_layout makes it of a library's own vector")
    shape = tuple(tensor.shape)
    raise ValueError(f"{name} must have shape (B, rows, cols, channels), B at least 1, got {shape}{hint}")


def check_descriptor(descriptor: Tensor, spec: HOGSpec, image_size: Sequence[int] | None) -> tuple[int, int]:
    """Height and width of the image, after checking that descriptor, spec and image size agree."""
    check_floats("the descriptor", descriptor)
    check_axes("the descriptor", descriptor)
    rows, cols, channels = descriptor.shape[1:]
    height, width = spec.image_size(rows, cols) if image_size is None else as_size("image_size", image_size)
    expected = (*spec.grid(height, width), spec.channels)
    if (rows, cols, channels) != expected:
        upright = (*spec.grid(width, height), spec.channels) == (rows, cols, channels)
        raise ValueError(
            f"{spec.named} descriptor of an image of {height}x{width} pixels must have shape "
            f"{expected} (rows, cols, channels), got {(rows, cols, channels)}"
            + f", that of {width}x{height}: image_size is (height, width), of a PIL image upright"
            * upright
        )
    check_finite("the descriptor", descriptor)
    largest = float(descriptor.detach().abs().max())
    if largest > LARGEST_ENTRY:
        raise ValueError(f"the descriptor's entries must be at most {LARGEST_ENTRY:g} in magnitude, got {largest:g}")
    return height, width


def convert_images(
    name: str, images: Tensor | ArrayImage | None, descriptor: Tensor, size: tuple[int, int], spec: HOGSpec
) -> Tensor | None:
    """``images`` in the descriptor's dtype and on its device; their square roots if the spec has ``gamma="sqrt"``."""
    if images is None:
        return None
    images, _ = as_unit_range(name, images)
    if images.shape != (len(descriptor), 1, *size):
        raise ValueError(f"{name} must have shape {(len(descriptor), 1, *size)}, got {tuple(images.shape)}")
    check_finite(name, images)
    brightest = float(images.detach().max())
    if brightest > 1 + LEVEL_OVERSHOOT:
        raise ValueError(f"{name} must be floats in 0…1, got up to {brightest:g}: divide by the value of white, 255")
    warn_about_levels(images)
    images = images.detach().to(descriptor)
    return images.clamp(min=0).sqrt() if spec.gamma == "sqrt" else images


class Quality(NamedTuple):
    """The budget of a search in evaluations of the operator: with several samples, without, or with a signed prior."""

    evaluations: int
    without_samples: int
    with_prior: int
    samples: int  # how many are drawn
    on_histograms: int  # evaluations of the normaliser alone, to invert it; they cost time per cell, not per pixel


QUALITIES: dict[QualityName, Quality] = {
    "best": Quality(evaluations=660, without_samples=480, with_prior=200, samples=4, on_histograms=200),
    "fast": Quality(evaluations=80, without_samples=80, with_prior=80, samples=2, on_histograms=60),
}


def find_quality(name: QualityName) -> Quality:
    check_choice("quality", name, QualityName)
    return QUALITIES[name]


@dataclass(frozen=True)
class Search:
    """How to search for a pre-image.

    Attributes:
        minimiser: ``"lbfgs"`` or ``"dogleg"`` (the paper's).
        max_evaluations: operator evaluations per image, at least 2; by default those of the quality: 660 where several
            samples are drawn, 200 with a prior for signed descriptors, else 480; or 80.
        samples: images whose mean is the expected image, at least 1; by default those of the quality, 4 or 2.  They are
            drawn for signed descriptors, or where a start is given; fewer if each would get less than 28 evaluations.
            A single one is only a start; then there is no expected image.

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
        for name, least in (("max_evaluations", 2), ("samples", 1)):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_integer(name, getattr(self, name), least))


@dataclass(frozen=True)
class Objective:
    """Terms added to the relative distance of the descriptors, Eq. 8-9.

    Attributes:
        smoothness: ξ of Eq. 9, on the scale of the distance, see :func:`.terms.smoothness`.
        closeness: λ of :class:`.search.PreimageObjective`, the weight of the distance to the expected image; by
            default 1 for signed dialects and for details, 3 for signed dialects with a learned prior, 0.1 for unsigned
            ones, whose region signs are uncertain.
        priors: further terms; with ``smoothness=0`` they replace the smoothness.

    Raises:
        ValueError: a number is negative or not finite.
        TypeError: ``priors`` are not priors.

    >>> from nablahog.invert import Objective
    >>> from nablahog.invert import Prior
    >>> class Squares(Prior):
    ...     def terms(self, image):
    ...         return image.diff(dim=3).flatten(1)
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), "uoctti")
    >>> objective = Objective(smoothness=0.1, priors=[Squares(1e-3)])
    >>> nablahog.reconstruct(descriptor, "uoctti", objective=objective, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    """

    smoothness: float = 0.02
    closeness: float | None = None
    priors: Sequence[Prior] = ()

    def __post_init__(self) -> None:
        for name in ("smoothness", "closeness"):
            if name == "smoothness" or self.closeness is not None:
                object.__setattr__(self, name, as_number(name, getattr(self, name), 0))
        if not isinstance(self.priors, Sequence) or not all(isinstance(prior, Prior) for prior in self.priors):
            raise TypeError(f"priors must be a list of Prior objects, got {self.priors!r}")
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
        keep_iterates: whether to return the image after each iteration, too.

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
        if self.smoothness is not None:
            object.__setattr__(self, "smoothness", as_number("smoothness", self.smoothness, above=0))
        object.__setattr__(self, "keep_iterates", as_truth("keep_iterates", self.keep_iterates))
        object.__setattr__(self, "iterations", as_integer("iterations", self.iterations))
        if self.max_evaluations is not None:
            object.__setattr__(self, "max_evaluations", as_integer("max_evaluations", self.max_evaluations, 2))


def check_settings(search: object, objective: object) -> None:
    """Raises TypeError unless these are a :class:`Search` and an :class:`Objective`."""
    check_type("search", search, Search, "nablahog.invert.Search(…)")
    check_type("objective", objective, Objective, "nablahog.invert.Objective(…)")


def as_published(method: InversionMethod | AsPublished, **options: tuple[object, object]) -> AsPublished | None:
    """The options of the paper's search, None for the default method; ValueError if an option of the latter is set."""
    if not isinstance(method, AsPublished):
        check_choice("method", method, InversionMethod)
        if method == "default":
            return None
        method = AsPublished()
    for name, (value, default) in options.items():
        if isinstance(value, Tensor | np.ndarray) or (value is not default and value != default):
            raise ValueError(f"{name} is an option of the default method; the paper's search does not take it")
    return method
