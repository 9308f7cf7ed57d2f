"""Pre-images in colour, for descriptors of colour images.

A descriptor that takes the channel of largest gradient at each pixel does not tell which one that was: the hues are a
guess.  But where two areas differ only in colour, a gray image cannot have their edge, and one in colour can.  A
descriptor of each channel determines the colours, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ..hog.descriptor import hog
from ..hog.spec import COLOURS, HOGSpec
from ..optimize import lbfgs
from .checks import check_descriptor
from .choices import QualityName
from .cosine import CosineBasis
from .histograms import searchable
from .objective import squared_norm
from .options import Objective, Search, quality_of
from .preimage import reconstruct
from .priors import RelativeSmoothness
from .reconstruction import Reconstruction, relative_distance, to_unit_range
from .search import EXPONENT
from .start import noise

SMOOTHNESS = 0.02  # ξ of Eq. 9, of the mean over channels
SATURATION = 0.3  # weight of the channels' mean square difference from gray, relative to the variance of the gray


def reconstruct_colour(
    descriptor: Tensor,
    spec: HOGSpec,
    image_size: Sequence[int] | None = None,
    *,
    quality: QualityName = "best",
    seed: int = 0,
    search: Search = Search(),
    objective: Objective = Objective(),
    progress: Callable[[int, int], None] | None = None,
) -> Reconstruction:
    """Images of three channels whose HOG is the given descriptor.

    A gray image is searched first (:func:`.preimage.reconstruct`); then its channels may differ where that brings the
    descriptor closer, but as little as possible.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, on any device.
        spec: the dialect that made it; its colour rule is not ``"gray"``.
        image_size: (height, width); by default whole cells.
        quality: of the gray image and of its colours, as :func:`.preimage.reconstruct` has it.
        seed: of the noise that the searches start from.
        search, objective: of the gray image.
        progress: called with the evaluations done and the most there can be, of the gray image.

    Returns:
        Images (B, 3, H, W) in 0…1, gray where no colours came closer; the history is that of the gray image, the
        evaluations count both.

    Raises:
        TypeError, ValueError: as :func:`.preimage.reconstruct`; the spec is of gray images.
    """
    if spec.colour == "gray":
        raise ValueError(f"{spec.named} descriptor is of gray images, and has no pre-image in colour")
    began = time.perf_counter()
    size = check_descriptor(descriptor, spec, image_size)
    gray = reconstruct(
        descriptor, spec, size, quality=quality, seed=seed, search=search, objective=objective, progress=progress
    )
    descriptor, model = descriptor.detach(), searchable(spec)
    rooted = spec.gamma == "sqrt"
    colours = _Colours(descriptor, model, gray.image.sqrt() if rooted else gray.image)
    minimum = lbfgs(
        colours, colours.start(seed), max_evaluations=quality_of(quality).on_colours, progress_tolerance=1e-3
    )
    image = to_unit_range(colours.images(minimum.x), model)
    if rooted:
        image = image.square()
    distance = relative_distance(image, descriptor, spec)
    closer = distance < gray.distance
    return replace(
        gray,
        image=torch.where(closer.view(-1, 1, 1, 1), image, gray.image),
        distance=torch.where(closer, distance, gray.distance),
        stop_reason=[f"{one}; colours: {two}" for one, two in zip(gray.stop_reason, minimum.stop_reason, strict=True)],
        evaluations=gray.evaluations + minimum.evaluations,
        seconds=time.perf_counter() - began,
    )


class _Colours:
    """The objective of images in colour: distance, smoothness, and saturation.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect, as :func:`.histograms.searchable` gives it.
        gray: (B, 1, H, W), where the search begins.
    """

    def __init__(self, descriptor: Tensor, spec: HOGSpec, gray: Tensor) -> None:
        self.descriptor, self.spec, self.gray = descriptor, spec, gray
        height, width = gray.shape[2:]
        self.basis = CosineBasis(height, width, descriptor, EXPONENT)
        self.smoothness = RelativeSmoothness(SMOOTHNESS)
        self.size = squared_norm(descriptor)
        contrast = (gray - gray.mean(dim=(2, 3), keepdim=True)).square().mean(dim=(1, 2, 3))
        self.contrast = torch.where(contrast > 0, contrast, 1)

    def start(self, seed: int) -> Tensor:
        """Unknowns (B, N) of the gray images with noise of their own in each channel."""
        height, width = self.gray.shape[2:]
        images = self.gray + noise(self.gray, height, width, COLOURS, seed)[0, :, 0]
        return self.basis.unknowns(images.reshape(-1, 1, height, width)).reshape(len(images), -1)

    def images(self, unknowns: Tensor) -> Tensor:
        """Unknowns (A, N) to images (A, 3, H, W)."""
        planes = self.basis.image(unknowns.reshape(len(unknowns) * COLOURS, -1))
        return planes.reshape(-1, COLOURS, *self.gray.shape[2:])

    @torch.enable_grad()
    def __call__(self, unknowns: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        unknowns = unknowns.detach().requires_grad_()
        image = self.images(unknowns)
        value = squared_norm(hog(image, self.spec) - self.descriptor[index]) / self.size[index]
        value = value + self.smoothness(image.flatten(0, 1)[:, None]).reshape(-1, COLOURS).mean(dim=1)
        saturation = (image - image.mean(dim=1, keepdim=True)).square().mean(dim=(1, 2, 3))
        value = value + SATURATION * saturation / self.contrast[index]
        (gradient,) = torch.autograd.grad(value.sum(), unknowns)
        return value.detach(), gradient
