"""Learning a prior from photographs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial

import torch
from torch import Tensor

from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .fitting import Precision, learn_network
from .histograms import searchable
from .learned import LearnedPrior
from .network import make_network, network_class
from .prior_network import Architecture
from .signed_training import SignedTraining
from .unsigned_training import UnsignedTraining


def train_prior(
    images: Mapping[str, Tensor],
    spec: HOGSpec | str,
    *,
    epochs: int | None = None,
    seed: int = 0,
    architecture: Architecture | None = None,
    start: LearnedPrior | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    device: torch.device | str = "cpu",
    precision: Precision | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> LearnedPrior:
    """Learns, from photographs, which image to expect for a descriptor.

    The network predicts random windows, up to brightness and contrast: of signed descriptors pixel by pixel
    (:mod:`.signed_training`), of unsigned ones their regions, and which side of these is bright
    (:mod:`.unsigned_training`).  A prior for one signed dialect is for all, and so is one for an unsigned dialect.  One
    image in 25, in the order of their names, is not trained with.

    The result depends on the images, whether the spec is signed, epochs, seed, architecture and precision alone, as
    long as PyTorch, its number of threads and the device stay the same.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: a dialect of the descriptors that it is for, or the name of a preset with its defaults.
        epochs: passes over the images, of one window each; by default as many as give 90,000 windows in all, or 300,000
            for unsigned descriptors.
        seed: of everything random.
        architecture: of the network; by default of 2.2 million weights for signed descriptors, of 5.3 million for
            unsigned ones.
        start: a prior for such descriptors to go on from: what it has learned is changed to what these images show.
        checkpoint: a file that is written after each epoch.  If it exists and is of the same training, this training is
            resumed, with the same result.  The file is not removed.  A damaged one is renamed, and the training starts
            afresh.
        device: where to compute.
        precision: of convolutions and matrix products in training; weights and losses are float32 in any case.
            ``"bfloat16"`` takes half the time where the processor has instructions for it.  By default float32 on a
            CPU, bfloat16 on a GPU with such instructions.
        progress: called with the steps done, their number, and epoch and loss.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; there can be no prior for the spec;
            there is no such preset or precision; ``start`` is for others, or of another architecture; ``epochs`` is
            below 1; the checkpoint is of another training; the training diverges.
        OSError: the checkpoint cannot be read or written.

    >>> images = {"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}
    >>> prior = nablahog.train_prior(images, nablahog.presets.uoctti(cell_size=8), epochs=1)

    >>> prior.learning.images, len(prior.learning.losses)
    (('noise',), 1)
    """
    spec = as_spec(spec)
    if start is not None:
        start.check(spec)
        if architecture not in (None, start.architecture):
            raise ValueError(f"the prior to go on from is of {start.architecture}, not of {architecture}")
        architecture = start.architecture
    architecture = architecture or network_class(spec).default_architecture(spec)
    network_class(spec).check(spec, architecture)
    weights, learning = learn_network(
        images,
        spec,
        SignedTraining if searchable(spec).signed else UnsignedTraining,
        partial(make_network, spec, architecture),
        [list(architecture.widths), list(architecture.blocks)],
        start=None if start is None else start.weights,
        epochs=epochs,
        seed=seed,
        checkpoint=checkpoint,
        device=device,
        precision=precision,
        progress=progress,
    )
    return LearnedPrior(spec, architecture, weights, learning)
