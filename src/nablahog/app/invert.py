"""Invert: a pre-image while it is searched, frame by frame, and its figures."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, TypeAlias

import torch
from torch import Tensor

from .. import metrics
from ..hog.gradient import gray
from ..hog.spec import HOGSpec
from ..invert import Iterate, Reconstruction, reconstruct
from ..invert.arguments import find_quality
from ..invert.histograms import linear_vote_spec, recover_histograms
from ..invert.reconstruction import SearchRecord
from ..invert.starts import starting_images
from ..invert.template import reconstruct_template
from ..requests.inversion import NO_PRIOR, SURE, InvertRequest
from ..requests.sources import Source
from ..viz.pictures import fade_unsure
from .messages import INVERT_SIZE, InvertMessage, RequestError, as_request_error, png
from .snippets import write_inversion_snippets
from .store import DescriptorEntry, Photograph, Store
from .work_queue import CancelToken

FRAME_PAUSE = 0.07  # seconds between frames, at least
FIRST_EVALUATIONS = 20  # evaluations before the first frame of a signed descriptor
MOST_POINTS = 200  # on the curve of distances
Event: TypeAlias = tuple[str, dict[str, Any]]


def invert(
    request: InvertMessage, entry: DescriptorEntry, store: Store, send: Callable[[Event], None], cancel: CancelToken
) -> None:
    """Searches the image, sends the events ``start``, ``frame`` and ``done``, and puts the result into the store."""
    source = entry.source
    height, width = source.image_size
    if max(height, width) > INVERT_SIZE:
        raise RequestError(413, f"expected an image of at most {INVERT_SIZE} pixels a side, got {height}x{width}")
    reference = source.gray_photo
    watch = _Watch(request, source.spec, reference, send, cancel)
    start = {
        "image_size": [height, width],
        "most": watch.most,
        "photograph": None if reference is None else png(reference),
    }
    send(("start", start))
    with as_request_error():
        result = (_search_template if entry.template else _search)(request, source, store, watch)
    image = result.image[0, 0]
    polarity = None if result.polarity_confidence is None else round(float(result.polarity_confidence[0]), 4)
    regions = result.region_confidence
    preimage = Photograph(f"pre-image of {source.name}", image[None])
    done = {
        "image": png(image),
        "id": store.add(preimage, image.numpy().tobytes()),
        **{name.lower(): value for name, value in _measures(image, reference).items()},
        "distance": float(result.distance[0]),
        "polarity": polarity,
        "negative": png(1 - image) if polarity is not None and polarity < SURE else None,
        "faded": None if regions is None else png(fade_unsure(image, regions[0, 0], SURE)),
        "evaluations": int(result.evaluations[0]),
        "stop_reason": str(result.stop_reason[0]),
        "seconds": round(result.seconds, 3),
        "history": _thin_out(result.history[:, 0]),
        "snippets": _snippets(request, entry),
        "definitions": {name.lower(): text for name, text in metrics.DEFINITIONS.items()},
    }
    send(("done", done))


def _search_template(request: InvertMessage, source: Source, _: Store, watch: _Watch) -> Reconstruction:
    descriptor, spec, size = source.descriptor[None], source.spec, source.image_size
    return reconstruct_template(descriptor, spec, size, seed=request.seed, progress=watch.progress)


def _search(request: InvertMessage, source: Source, store: Store, watch: _Watch) -> Reconstruction:
    descriptor, spec, size = source.descriptor[None], source.spec, source.image_size
    start = None if request.start is None else _start(store, request.start, size)
    if start is None and linear_vote_spec(spec).signed:
        SearchRecord(descriptor, spec, watch, slice(None)).show_first(_integral(descriptor, spec, size))
    try:
        prior = request.priors_for(spec)
    except FileNotFoundError:  # the package was installed without its priors, as the page says
        prior = None
    return reconstruct(descriptor, spec, size, **{**request.keywords(), "prior": prior}, start=start, watch=watch)


def _snippets(request: InvertMessage, entry: DescriptorEntry) -> dict[str, str]:
    source = entry.reading or entry.source.path
    if entry.template:
        return write_inversion_snippets(InvertRequest(template=True, seed=request.seed), source)
    snippets = write_inversion_snippets(request, source)
    if request.start is not None:
        begins = "# from the beginning, not from the image that the page continued from"
        snippets = {name: f"{begins}\n{text}" for name, text in snippets.items()}
    return snippets


def _integral(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """A rough image that the votes integrate to, shown while the search prepares."""
    histograms = recover_histograms(descriptor, linear_vote_spec(spec), size, max_evaluations=FIRST_EVALUATIONS)
    return starting_images(histograms, linear_vote_spec(spec), *size, count=1, seed=0, spread=0.0)[:, 0]


def _start(store: Store, key: str, size: tuple[int, int]) -> Tensor:
    image = gray(store.get(key, Photograph).image[None])
    if tuple(image.shape[2:]) != size:
        got = "x".join(map(str, image.shape[2:]))
        raise RequestError(422, f"an image to continue from must have {size[0]}x{size[1]} pixels, got {got}")
    return image


class _Watch:
    """Sends a frame of the search now and then, and ends the search when nobody waits for it.

    ``most`` is the largest number of evaluations; None where iterations are counted.
    """

    def __init__(
        self,
        request: InvertMessage,
        spec: HOGSpec,
        reference: Tensor | None,
        send: Callable[[Event], None],
        cancel: CancelToken,
    ) -> None:
        self.reference, self.send, self.cancel = reference, send, cancel
        effort = find_quality(request.quality)
        signed = effort.evaluations if request.prior == NO_PRIOR else effort.with_prior
        most = signed if spec.signed else effort.without_samples
        self.most = None if request.method == "paper" else most
        self._sent = -math.inf

    def __call__(self, iterate: Iterate) -> None:
        self.cancel.check()
        if time.monotonic() - self._sent < FRAME_PAUSE:
            return
        image = iterate.image[0, 0]
        figures = _measures(image, self.reference, ("CC", "SSIM"))
        frame = {
            "evaluations": int(iterate.evaluations[0]),
            "most": self.most,
            "distance": float(iterate.distance[0]),
            "cc": figures["CC"],
            "ssim": figures["SSIM"],
            "image": png(image),
        }
        self.send(("frame", frame))
        self._sent = time.monotonic()

    def progress(self, done: int, most: int) -> None:
        """For templates, which have no frames."""
        self.cancel.check()


def _measures(
    image: Tensor, reference: Tensor | None, names: tuple[str, ...] = tuple(metrics.MEASURES)
) -> dict[str, float | None]:
    if reference is None:
        return dict.fromkeys(names)
    figures = {name: metrics.MEASURES[name](image, reference) for name in names}
    return {name: round(value, 5) if math.isfinite(value) else None for name, value in figures.items()}


def _thin_out(distances: Tensor) -> list[float]:
    """At most :data:`MOST_POINTS` of the distances, the last one included."""
    steps = torch.linspace(0, len(distances) - 1, min(MOST_POINTS, len(distances))).round().long()
    return [round(value, 5) for value in distances[steps].tolist()]
