"""What ``nablahog hog``, ``glyph`` and ``invert``, and the same views of the page, can be asked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..hog import HOGSpec
from ..invert.choices import InversionMethod, QualityName
from .dialect import Dialect, presets_with
from .options import SIZE, TEXT, integer, keywords, option, path

if TYPE_CHECKING:
    from ..invert.prior.choice import PriorChoice
    from ..invert.prior.learned import LearnedPrior

LONGER_SIDE = 256  # pixels: the pre-image of such a photograph takes seconds
MOST_SAMPLES = 64
SURE = 0.8  # confidence below which the negative of an image is shown, too, and regions are drawn grayer
DEFAULT, NO_PRIOR = "default", "none"
_SHRINK = "shrink photographs to at most N pixels on the longer side; 0 keeps their size"
_EXCLUDED = {
    "template": ("quality fast", "method paper", "prior", "samples"),
    "method paper": ("quality fast", "prior", "samples"),
    "samples": ("prior none",),
}
"""What excludes each other."""


@dataclass(frozen=True, kw_only=True)
class HogRequest(Dialect):
    """The descriptor of a photograph."""

    size: int = option(0, _SHRINK, integer(0))


@dataclass(frozen=True, kw_only=True)
class GlyphRequest(HogRequest):
    """A picture of a descriptor: that of a photograph, or one from a file, which may be an array of another library."""

    size: int = option(LONGER_SIDE, _SHRINK, integer(0))
    image_size: tuple[int, int] | None = option(
        None, "height x width of an array's image; without it, what the numbers tell", SIZE
    )
    row: int | None = option(None, "the row of a matrix of descriptors, counted from 0; all by default", integer(0))
    key: str | None = option(None, "name of the array, if the file holds several", TEXT)

    def __post_init__(self) -> None:
        """Without a preset, an array may be of any that has these parameters."""
        if self.preset is not None or not presets_with(self.settings):
            super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class InvertRequest(GlyphRequest):
    """An image with a descriptor, or what a detector looks for."""

    template: bool = option(
        False,
        "inputs are the weights of linear detectors, in arrays, DPM models (.mat) or files that OpenCV's "
        "HOGDescriptor saved (.yml, .xml, .json): show what they look for",
    )
    quality: QualityName = option("best", "best, or fast: coarser, with fewer evaluations", keyword=True, on_page=True)
    method: InversionMethod = option(
        "default", "how to search: default, or paper, the paper's own, which is much slower", keyword=True, on_page=True
    )
    prior: str = option(
        DEFAULT,
        "a file of `nablahog learn prior`, none, or default: that which comes with nablahog",
        path("FILE"),
        on_page=(DEFAULT, NO_PRIOR),
    )
    samples: int | None = option(
        None,
        "show N other images for an unsigned descriptor: they differ where it leaves the image open",
        integer(2, MOST_SAMPLES),
    )
    seed: int = option(
        0,
        "seed of the random numbers, of which a search from a learned prior draws none",
        integer(0),
        keyword=True,
        on_page=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        asked = {
            "template": self.template,
            "quality fast": self.quality == "fast",
            "method paper": self.method == "paper",
            "prior": self.prior not in (DEFAULT, NO_PRIOR),
            "prior none": self.prior == NO_PRIOR,
            "samples": self.samples is not None,
        }
        for name, others in _EXCLUDED.items():
            for other in others:
                if asked[name] and asked[other]:
                    raise ValueError(f"{name} and {other} exclude each other: leave out one of them")

    def keywords(self) -> dict[str, Any]:
        """The keywords of :func:`nablahog.reconstruct` that ask for the same."""
        return keywords(self, InvertRequest) | ({"prior": None} if self.prior == NO_PRIOR else {})

    @property
    def prior_file(self) -> Path | None:
        """The file of the prior, if there is one."""
        return None if self.prior in (DEFAULT, NO_PRIOR) else Path(self.prior)

    def learned_prior(self) -> LearnedPrior | None:
        """The prior of the file, if there is one; OSError or ValueError if it cannot be read."""
        if self.prior_file is None:
            return None
        from ..invert.prior.learned import LearnedPrior
        from ..io.learned_model import load_once

        return load_once(LearnedPrior, self.prior_file)

    def priors_for(self, spec: HOGSpec) -> PriorChoice:
        """The priors for descriptors of ``spec``: those of the package, that of the file, or none.

        Raises:
            OSError, ValueError: the file cannot be read, or is for other descriptors.
            FileNotFoundError: the package was installed without its priors.
        """
        from ..invert.prior.choice import default_prior_file, default_priors

        if self.template or self.method == "paper" or self.prior == NO_PRIOR:
            return None
        learned = self.learned_prior()
        if learned is not None:
            learned.check(spec)
            return learned
        return None if default_prior_file(spec) is None else default_priors(spec)

    def draws_random_numbers(self, spec: HOGSpec) -> bool:
        """Whether the seed counts: not for a search from a learned prior, but for samples; errors as above."""
        return self.samples is not None or self.priors_for(spec) is None
