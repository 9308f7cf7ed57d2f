"""The inversion of a descriptor on a cluster, as a job whose result is stored."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from ...invert import LearnedPrior
from ...invert.learned import PriorChoice
from ...jobs.store import JobResult, digest, key_of
from ...jobs.worker import local_path
from ...paper.learned import load
from ...runtime.cache import code_key
from ..inputs.prior import PriorOptions
from ..inputs.sources import Source
from .inversion import Inversion, InversionOptions, invert_batch

_STORED = ("measures", "stop_reason", "polarity", "agreement")  # fields of an inversion that are no pictures


@dataclass(frozen=True, eq=False)
class InversionJob:
    """The inversion of a descriptor.

    Attributes:
        source: the descriptor, and the photograph if it is known.
        options: of the search.
        prior: the file of a learned prior; None for none.
        default: whether the priors that come with the package are used.
    """

    source: Source
    options: InversionOptions
    prior: Path | None
    default: bool

    @property
    def name(self) -> str:
        """The name of its folder of stored results."""
        return "inversions"

    def key(self) -> str:
        """A hash of the descriptor, the photograph, the options, the prior, and the code that makes the result."""
        source = self.source
        photo = b"" if source.photo is None else source.photo.numpy().tobytes()
        facts = {
            "spec": source.spec.to_json(),
            "image_size": source.image_size,
            "photo": hashlib.sha256(photo).hexdigest(),
            "options": asdict(self.options),
            "prior": self.default if self.prior is None else digest(self.prior),
            "code": code_key(InversionJob),
        }
        return key_of(facts, source.descriptor.numpy())

    def files(self) -> list[Path]:
        """The file of the prior, if there is one."""
        return [] if self.prior is None else [self.prior]

    def run(self) -> JobResult:
        """Inverts the descriptor: the pictures are the pre-image, the iterates and the samples, float32."""
        [result] = invert_batch([self.source], device=torch.device("cpu"), prior=self._prior(), options=self.options)
        samples = [] if result.samples is None else list(result.samples)
        pictures = np.stack([each.numpy() for each in (result.preimage, *result.iterates.values(), *samples)])
        figures = {name: getattr(result, name) for name in _STORED}
        figures |= {"iterates": list(result.iterates), "samples": len(samples)}
        return JobResult([figures], pictures, result.seconds)

    def fits(self, result: JobResult) -> bool:
        """Whether there are as many pictures as the figures say, of the image's size."""
        figures, pictures = result.figures[0], result.pictures
        count = 1 + len(figures["iterates"]) + figures["samples"]
        whole = len(pictures) == count and pictures.shape[-2:] == self.source.image_size
        return bool(whole and pictures.dtype == np.float32)

    def inversion(self, result: JobResult) -> Inversion:
        """The inversion that :meth:`run` has computed."""
        figures, pictures = result.figures[0], torch.from_numpy(result.pictures)
        samples_from = 1 + len(figures["iterates"])
        samples = pictures[samples_from:]
        return Inversion(
            self.source,
            pictures[0],
            seconds=result.seconds,
            iterates=dict(zip(figures["iterates"], pictures[1:samples_from], strict=True)),
            samples=samples if len(samples) else None,
            **{name: figures[name] for name in _STORED},
        )

    def _prior(self) -> PriorChoice:
        given: LearnedPrior | None = None if self.prior is None else load("prior", local_path(self.prior))
        return PriorOptions(given, self.default).for_spec(self.source.spec)
