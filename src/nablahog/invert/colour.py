"""Pre-images in colour, of descriptors that read colour.

A descriptor that takes the channel of largest gradient at each pixel does not say which one that was, so that what is
red and what is blue is anybody's guess.  But where two areas differ in colour alone, no gray image has their edge where
the descriptor has it; one in colour does.  A descriptor of each channel tells their colours, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from ..hog.descriptor import hog
from ..hog.spec import COLOURS, HOGSpec
from ..optimize import lbfgs
from .histograms import searchable
from .objective import squared_norm
from .parameterize import CosineBasis
from .preimage import Reconstruction, check_descriptor, reconstruct, relative_distance, to_unit_range
from .priors import RelativeSmoothness
from .quality import QualityName, quality_of
from .search import EXPONENT
from .start import noise

SMOOTHNESS = 0.02  # ξ of Eq. 9, of the mean over channels
SATURATION = 0.3  # weight of the channels' mean square difference from gray, relative to its own variance


def reconstruct_colour(
    descriptor: Tensor,
    spec: HOGSpec,
    image_size: tuple[int, int] | None = None,
    *,
    quality: QualityName = "best",
    seed: int = 0,
    colour_evaluations: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Reconstruction:
    """Images of three channels whose HOG is the given descriptor.

    A gray one is found first (:func:`.preimage.reconstruct`, which takes the other ``options``); then its channels may
    go apart where that brings the descriptor closer, but as little as possible.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64, on any device.
        spec: the dialect that made it; its colour rule is not ``"gray"``.
        image_size: (height, width); by default whole cells.
        quality: of the gray image and of its colours, as :func:`.preimage.reconstruct` has it.
        seed: of the noise that the searches start from.
        colour_evaluations: operator evaluations that an image may spend on its colours, at least 2, instead of the
            quality's 300 or 60.
        progress: called with the evaluations done and the most there can be, of the gray image.

    Returns:
        Images (B, 3, H, W) in 0…1, gray where no colours came closer; the history is that of the gray image, the
        evaluations count both.

    Raises:
        TypeError, ValueError: as :func:`.preimage.reconstruct`; the spec is of gray images.
    """
    if spec.colour == "gray":
        raise ValueError(f"{spec.named} descriptor is of gray images, and has no pre-image in colour")
    if colour_evaluations is None:
        colour_evaluations = quality_of(quality).on_colours
    if colour_evaluations < 2:
        raise ValueError(f"colour_evaluations must be at least 2, got {colour_evaluations}")
    began = time.perf_counter()
    height, width = check_descriptor(descriptor, spec, image_size)
    found = reconstruct(descriptor, spec, (height, width), quality=quality, seed=seed, progress=progress, **options)
    descriptor, sought = descriptor.detach(), searchable(spec)
    rooted = spec.gamma == "sqrt"
    plain = found.image.sqrt() if rooted else found.image
    start = plain + noise(plain, height, width, COLOURS, seed)[0, :, 0]
    basis = CosineBasis(height, width, descriptor, EXPONENT)
    smooth = RelativeSmoothness(SMOOTHNESS)
    size = squared_norm(descriptor)
    contrast = (plain - plain.mean(dim=(2, 3), keepdim=True)).square().mean(dim=(1, 2, 3))
    contrast = torch.where(contrast > 0, contrast, 1)

    def images(unknowns: Tensor) -> Tensor:
        return basis.image(unknowns.reshape(len(unknowns) * COLOURS, -1)).reshape(-1, COLOURS, height, width)

    @torch.enable_grad()
    def objective(unknowns: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        unknowns = unknowns.detach().requires_grad_()
        image = images(unknowns)
        value = squared_norm(hog(image, sought) - descriptor[index]) / size[index]
        value = value + smooth(image.flatten(0, 1)[:, None]).reshape(-1, COLOURS).mean(dim=1)
        away = (image - image.mean(dim=1, keepdim=True)).square().mean(dim=(1, 2, 3))
        value = value + SATURATION * away / contrast[index]
        (gradient,) = torch.autograd.grad(value.sum(), unknowns)
        return value.detach(), gradient

    unknowns = basis.unknowns(start.reshape(-1, 1, height, width)).reshape(len(start), -1)
    search = lbfgs(objective, unknowns, max_evaluations=colour_evaluations, progress_tolerance=1e-3)
    image = to_unit_range(images(search.x), sought)
    if rooted:
        image = image.square()
    distance = relative_distance(image, descriptor, spec)
    closer = distance < found.distance
    image = torch.where(closer.view(-1, 1, 1, 1), image, found.image)
    distance = torch.where(closer, distance, found.distance)
    return replace(
        found,
        image=image,
        distance=distance,
        stop_reason=[f"{one}; colours: {two}" for one, two in zip(found.stop_reason, search.stop_reason, strict=True)],
        evaluations=found.evaluations + search.evaluations,
        seconds=time.perf_counter() - began,
    )
