"""Training a learned prior on photographs; an interrupted training is resumed with the same result."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any, Literal, TypeAlias

import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_
from torch.optim.lr_scheduler import OneCycleLR

from ...hog.dialects import as_spec
from ...hog.spec import HOGSpec
from ...inputs.arrays import ArrayImage
from ...inputs.numbers import as_integer, check_callable, check_choice
from ...inputs.training_images import digest_of_images, gray_photographs
from ...io.checkpoint import Checkpoint
from ...io.learned_model import build_network, flatten_all, fold_statistics, unfold_statistics
from ...io.learner import Learner
from ...runtime.pytorch import in_float32, in_plain_mode, seeded
from ..histograms import linear_vote_spec
from .calibration import calibrate
from .learned import LearnedPrior, network_class
from .provenance import NetworkLearning, digest_of_weights
from .signed_network import Architecture
from .training_windows import SignedTraining, UnsignedTraining, WindowTraining

Precision: TypeAlias = Literal["float32", "bfloat16"]
LARGEST_GRADIENT = 1.0  # norm
WARM_UP, FIRST_RATE, LAST_RATE = 0.1, 1 / 25, 1e-5  # share of the steps; learning rates, relative to the largest
RESTART_RATE = 0.5  # largest learning rate of a training that starts from a prior, relative to the usual one
STATISTICS_BATCHES = 20  # batches for the means and variances at the start of such a training


def least_side(cell: int) -> int:
    """The least height and width of a photograph, in pixels, for cells of ``cell`` pixels."""
    return max(32, 4 * cell)


def default_precision(device: torch.device) -> Precision:
    """``"bfloat16"`` on a GPU that has instructions for it, else ``"float32"``."""
    if device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        return "bfloat16"
    return "float32"


@in_plain_mode
def train_prior(
    images: Mapping[str, Tensor | ArrayImage],
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
    """Trains a network on photographs to predict the image to expect for a descriptor.

    It predicts random windows, up to brightness and contrast: for signed descriptors pixel by pixel, for unsigned ones
    their regions (:mod:`.training_windows`).  A prior for one signed dialect is for all signed dialects; the same holds
    for unsigned ones.  One folder in 25 is held out, in the order of their names, or one image in 25 if there are fewer
    folders.  Of unsigned descriptors these calibrate how sure the prior is: photographs of one folder are alike, so
    only other folders show how sure it may be.

    The result depends only on the images, whether the spec is signed, epochs, seed, architecture and precision, as long
    as PyTorch, its number of threads and the device stay the same.

    Args:
        images: gray ones by name, (H, W) each, tensors or arrays in 0…1 or uint8, or PIL images; of a large folder each
            is drawn less often.
        spec: a dialect of the descriptors that it is for, or the name of a preset with its defaults.
        epochs: each of at most as many windows as images; by default as many as give 90,000 windows in all, or
            300,000 for unsigned descriptors.
        seed: the seed of all random numbers.
        architecture: that of the network; by default with 2.2 million weights for signed descriptors, 4.6 million for
            unsigned ones.
        start: a prior for such descriptors, whose weights are trained further; by default random weights.
        checkpoint: a file that is written after each epoch.  If it exists and is of the same training, this training is
            resumed, with the same result.  The file is not removed.
        device: where to compute.
        precision: for convolutions and matrix products in training; weights and losses are float32 in any case.
            ``"bfloat16"`` takes half the time where the processor has instructions for it.  By default float32 on a
            CPU, bfloat16 on a GPU with such instructions.
        progress: called with the steps done, their number, and epoch and loss.

    Raises:
        TypeError: ``images`` is no dict, or has something that is no image.
        ValueError: there are no images, or one is too small or holds other values; there can be no prior for the spec;
            there is no such preset or precision; ``start`` is for others, or has another architecture; ``epochs`` is
            below 1; the checkpoint is damaged or of another training; the training diverges.
        OSError: the checkpoint cannot be read or written.

    >>> images = {"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}
    >>> prior = nablahog.train_prior(images, nablahog.presets.uoctti(cell_size=8), epochs=1)

    >>> prior.learning.images, len(prior.learning.losses)
    (('noise',), 1)
    """
    spec, device = as_spec(spec), torch.device(device)
    if start is not None:
        start.check(spec)
        if architecture not in (None, start.architecture):
            raise ValueError(f"start must have the {architecture}, got the {start.architecture}")
        architecture = start.architecture
    network = network_class(spec)
    architecture = architecture or network.DEFAULT
    network.check(architecture)
    precision = precision or default_precision(device)
    check_choice("precision", precision, Precision)
    photographs = gray_photographs(images, (least_side(spec.cell_size[0]),) * 2)
    seed = as_integer("seed", seed, least=0)
    kind = SignedTraining if linear_vote_spec(spec).signed else UnsignedTraining
    training = kind(photographs, seed)
    if epochs is None:
        epochs = max(1, round(training.default_crops / training.crops))
    epochs = as_integer("epochs", epochs)
    check_callable("progress", progress, "done, total, what")
    digest, start_digest = digest_of_images(photographs), "" if start is None else digest_of_weights(start.weights)
    identity = {
        "images": digest,
        "spec": spec.to_json(),
        "epochs": epochs,
        "seed": seed,
        "architecture": [list(architecture.widths), list(architecture.blocks)],
        "precision": precision,
        "start": start_digest,
    }
    weights, losses = _fit(
        partial(network, architecture),
        training,
        None if start is None else start.weights,
        Checkpoint(checkpoint, identity),
        device,
        progress,
    )
    learning = NetworkLearning(
        images=tuple(photographs),
        sha256=digest,
        seed=seed,
        epochs=epochs,
        losses=tuple(losses),
        start=start_digest,
        precision=precision,
    )
    prior = LearnedPrior(spec, architecture, weights.half(), learning)
    return prior if prior.signed else calibrate(prior, training.held_out)


PRIOR_LEARNER = Learner(LearnedPrior, train_prior, network_class, lambda spec: (least_side(spec.cell_size[0]),) * 2)
"""How `nablahog learn prior` learns."""


def _fit(
    make: Callable[[], nn.Module],
    training: WindowTraining,
    start: Tensor | None,
    checkpoint: Checkpoint,
    device: torch.device,
    progress: Callable[[int, int, str], None],
) -> tuple[Tensor, list[float]]:
    """The weights (n,), float32, on the CPU, after training by AdamW, and the mean loss of each epoch.

    ``make`` may draw weights from the global generator, which is not changed.
    """
    identity = checkpoint.identity
    steps, epochs, seed = training.steps, identity["epochs"], identity["seed"]
    half = identity["precision"] == "bfloat16"
    with seeded(seed), in_float32():
        network = (make() if start is None else build_network(make, start)).to(device)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # convolutions take a fifth less time
    if start is not None:
        with seeded(seed):
            batches = islice(training.batches(0), STATISTICS_BATCHES)
            unfold_statistics(network, lambda: [training.loss(network, _move_to(device, batch)) for batch in batches])
    largest = training.learning_rate * (1.0 if start is None else RESTART_RATE)
    optimizer = torch.optim.AdamW(network.parameters(), largest, weight_decay=training.weight_decay)
    schedule = learning_rates(optimizer, largest, epochs * steps)
    parts: dict[str, Any] = {"network": network, "optimizer": optimizer, "schedule": schedule}
    losses: list[float] = []

    def restore(state: Mapping[str, Any]) -> None:
        for name, part in parts.items():
            part.load_state_dict(state[name])
        losses.extend(state["losses"])

    checkpoint.resume(restore)
    for epoch in range(len(losses), epochs):
        step_losses: list[Tensor] = []
        with seeded(seed + epoch):  # of dropout
            for step, batch in enumerate(training.batches(epoch)):
                progress(epoch * steps + step, epochs * steps, _report(epoch, epochs, losses))
                with torch.autocast(device.type, torch.bfloat16, enabled=half):
                    loss = training.loss(network, _move_to(device, batch))
                optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
                optimizer.step()
                schedule.step()
                step_losses.append(loss.detach())  # a tensor, so that a GPU goes on with the next step
        total = sum(torch.stack(step_losses).tolist())
        if not math.isfinite(total):
            raise ValueError(f"the training has diverged in epoch {epoch + 1}: the loss is {total}")
        losses.append(total / steps)
        checkpoint.save({"losses": losses, **{name: part.state_dict() for name, part in parts.items()}})
    fold_statistics(network.eval())
    progress(epochs * steps, epochs * steps, _report(epochs - 1, epochs, losses))
    return flatten_all(network.parameters()), losses


def learning_rates(optimizer: torch.optim.Optimizer, largest: float, steps: int) -> OneCycleLR:
    """One cycle of half cosines: up to the largest rate in a tenth of the steps, and down to nearly 0."""
    return OneCycleLR(
        optimizer,
        largest,
        total_steps=max(steps, 11),  # with 10, OneCycleLR divides by zero
        pct_start=WARM_UP,
        div_factor=1 / FIRST_RATE,
        final_div_factor=FIRST_RATE / LAST_RATE,
        cycle_momentum=False,
    )


def _move_to(device: torch.device, batch: Any) -> Any:
    return type(batch)(*(part.to(device) for part in batch))


def _report(epoch: int, epochs: int, losses: Sequence[float]) -> str:
    return f"epoch {epoch + 1} of {epochs}" + (f", loss {losses[-1]:.4f}" if losses else "")
