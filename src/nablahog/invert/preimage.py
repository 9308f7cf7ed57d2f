"""Section 3.1, single-scale: a pre-image from the descriptor alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import torch
from torch import Tensor

from ..hog.descriptor import hog
from ..hog.spec import HOGSpec
from ..optimize import History, Minimiser, minimise
from .flat import FlatRegions
from .histograms import fixes_contrast, recover_histograms
from .objective import PreimageObjective, squared_norm
from .parameterize import CosineBasis, Parameterization, Pixels
from .priors import Prior, RelativeSmoothness
from .start import starting_image

Basis: TypeAlias = Literal["cosine", "pixels"]
EXPONENT = 0.75  # of the cosine basis: 1 converges first in the large, 0.5 in the small
SHARE_OF_VOTES = 0.7  # of the evaluations go to the histograms, the rest to the descriptor
TAILS = 0.005  # share of pixels that may be clipped at either end when the image is brought to 0…1


@dataclass(frozen=True)
class Reconstruction:
    """Pre-images of a batch of descriptors.

    Attributes:
        image: (B, 1, H, W) in 0…1.
        distance: (B,), ‖φ(image) - descriptor‖ / ‖descriptor‖, of exactly this image.
        stop_reason: why the search for each image ended.
        history: (evaluations, B), the relative distance of the image evaluated last, after each evaluation; a search
            that has ended repeats its last.
        evaluations: (B,), operator evaluations spent on each image, one forward and backward; a product of the Jacobian
            or its transpose with a vector is half of one.
        seconds: wall time for the whole batch.
    """

    image: Tensor
    distance: Tensor
    stop_reason: list[str]
    history: Tensor
    evaluations: Tensor
    seconds: float


def to_unit_range(image: Tensor, spec: HOGSpec) -> Tensor:
    """Bring images (B, 1, H, W) of arbitrary brightness to 0…1.

    HOG fixes no brightness, and except for Eq. 7 as printed no contrast.  An image whose contrast is known keeps it
    and is shifted, its range centred on 0.5; any other is stretched so that 0.5 % of its pixels fall on 0 and 0.5 % on
    1.  What still exceeds 0…1 is clipped.
    """
    pixels = image.flatten(1)
    clipped = round(TAILS * (pixels.shape[1] - 1))
    low, high = (
        pixels.kthvalue(k, dim=1).values.reshape(-1, 1, 1, 1) for k in (1 + clipped, pixels.shape[1] - clipped)
    )
    if fixes_contrast(spec):
        return (image - (low + high) / 2 + 0.5).clamp(0, 1)
    spread = high - low
    return torch.where(spread > 0, (image - low) / torch.where(spread > 0, spread, 1), 0.5).clamp(0, 1)


def reconstruct(
    descriptor: Tensor,
    spec: HOGSpec,
    image_size: tuple[int, int] | None = None,
    *,
    seed: int = 0,
    max_evaluations: int = 320,
    smoothness: float = 0.02,
    prior: Prior | Sequence[Prior] = (),
    basis: Basis = "cosine",
    minimiser: Minimiser = "lbfgs",
    progress: Callable[[int, int], None] | None = None,
) -> Reconstruction:
    """Images whose HOG is the given descriptor, from the descriptor alone, for a whole batch at once.

    Three steps: the histograms before normalisation (:mod:`.histograms`), an image with these histograms, and from
    there an image with this descriptor.  Each image has its own steps and its own stop, so a batch finds what its
    images alone would find, up to rounding, which a long search may amplify.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, on any device.
        spec: the dialect that made it.
        image_size: (height, width); by default whole cells, rows · cell height and cols · cell width.
        seed: of the noise that the search starts from.  The same for every image of the batch.
        max_evaluations: operator evaluations an image may spend, at least 2.
        smoothness: ξ of Eq. 9, on the distance's own scale (see :func:`.priors.smoothness`).
        prior: one or several, added to the above; with ``smoothness=0``, instead of it.
        basis: the unknowns, ``"cosine"`` or, as in the paper, ``"pixels"``.
        minimiser: ``"lbfgs"``, ``"dogleg"`` (the paper's), ``"momentum"`` or ``"adam"``.
        progress: called with the evaluations done and the most there can be.

    Raises:
        TypeError: the descriptor is no floating-point tensor.
        ValueError: its shape contradicts spec and image size, it holds NaN or Inf, or an option is out of range.
    """
    height, width = _check(descriptor, spec, image_size)
    if basis not in get_args(Basis):
        raise ValueError(f"basis must be one of {', '.join(map(repr, get_args(Basis)))}, got {basis!r}")
    if max_evaluations < 2:
        raise ValueError(f"max_evaluations must be at least 2, one for each objective, got {max_evaluations}")
    if not 0 <= smoothness < float("inf"):
        raise ValueError(f"smoothness must be a finite number of at least 0, got {smoothness}")
    priors: list[Prior] = [RelativeSmoothness(smoothness)] if smoothness else []
    priors += [prior] if isinstance(prior, Prior) else prior
    began = time.perf_counter()
    descriptor = descriptor.detach()
    distances = torch.full((len(descriptor),), torch.inf, dtype=descriptor.dtype, device=descriptor.device)
    evaluations = torch.zeros(len(descriptor), dtype=torch.long, device=descriptor.device)
    history = History(descriptor, len(descriptor))
    done = 0

    def report(distance: Tensor, index: Tensor) -> None:
        distances[index] = distance

    def watch(index: Tensor, spent: Tensor) -> None:
        nonlocal done
        spent = evaluations[index] + spent
        history.add(spent, index, distances[index])
        if progress is not None and int(spent.max()) > done:
            done = int(spent.max())
            progress(done, max_evaluations)

    unknowns: Parameterization = (
        CosineBasis(height, width, descriptor, EXPONENT) if basis == "cosine" else Pixels(height, width)
    )
    flat = FlatRegions(descriptor, spec, height, width)
    votes = recover_histograms(descriptor, spec)
    start = unknowns.unknowns(starting_image(votes, spec, height, width, seed))
    reasons: list[str] = []
    on_votes = max(1, min(max_evaluations - 1, round(SHARE_OF_VOTES * max_evaluations)))
    for target, budget in ((votes, on_votes), (None, max_evaluations - on_votes)):
        objective = PreimageObjective(descriptor, target, spec, unknowns, flat, priors, report)
        found = minimise(minimiser, objective, start, max_evaluations=budget, progress_tolerance=1e-3, watch=watch)
        start, reasons, evaluations = found.x, found.stop_reason, evaluations + found.evaluations
    index = torch.arange(len(descriptor), device=descriptor.device)
    image = to_unit_range(objective.image(start, index), spec)
    with torch.no_grad():
        residual = (hog(image, spec) - descriptor).flatten(1).norm(dim=1)
        distance = residual / squared_norm(descriptor).sqrt()
    seconds = time.perf_counter() - began
    return Reconstruction(image, distance, reasons, history.filled(int(evaluations.max())), evaluations, seconds)


def _check(descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int] | None) -> tuple[int, int]:
    """Height and width of the image to find, once descriptor, spec and image size agree."""
    if not isinstance(descriptor, Tensor) or descriptor.dtype not in (torch.float32, torch.float64):
        got = descriptor.dtype if isinstance(descriptor, Tensor) else type(descriptor).__name__
        raise TypeError(f"the descriptor must be a float32 or float64 tensor, got {got}")
    if descriptor.dim() != 4 or not len(descriptor):
        raise ValueError(
            f"the descriptor must have shape (B, rows, cols, channels), B at least 1, got {tuple(descriptor.shape)}"
        )
    rows, cols, channels = descriptor.shape[1:]
    height, width = image_size or (rows * spec.cell_size[0], cols * spec.cell_size[1])
    expected = (*spec.grid(height, width), spec.channels)
    if (rows, cols, channels) != expected:
        raise ValueError(
            f"a {spec.name} descriptor of an image of {height}x{width} pixels must have shape "
            f"{expected} (rows, cols, channels), got {(rows, cols, channels)}"
        )
    if not torch.isfinite(descriptor).all():
        raise ValueError("the descriptor must be finite, got NaN or Inf")
    return height, width
