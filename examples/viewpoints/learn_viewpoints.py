"""Learns from which side a chair is seen: the viewpoint prior of ``estimate_pose``.

``python examples/viewpoints/learn_viewpoints.py --images DIR -o chairs.npz`` renders procedural chairs in front of the
photographs of a folder, best without chairs, and trains a network to tell azimuths from descriptors.  70,000 scenes
take about an hour on one core of a processor that multiplies numbers in bfloat16: half of it to render, half to train.
``estimate_pose(..., viewpoints=ViewpointPrior.load("chairs.npz"))`` uses the result.

The prior that comes with the package was learned by this program, see ``docs/default_viewpoints.md``.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from nablahog import Mesh
from nablahog.invert.prior.provenance import digest_of_images
from nablahog.io.learned_model import flatten_all, fold_statistics
from nablahog.io.photographs import read_folder
from nablahog.paper.scenes import Scene, SceneSettings, scene
from nablahog.pose.background import FINE_CELL, pose_spec
from nablahog.pose.crop import crop_object
from nablahog.pose.model import VIEW_COUNT, equidistant_azimuths
from nablahog.pose.similarity import describe
from nablahog.pose.viewpoint_prior import (
    NETWORK_WIDTH,
    ViewpointLearning,
    ViewpointNetwork,
    ViewpointPrior,
    mirror_descriptors,
)
from nablahog.runtime.pytorch import seeded

CHAIRS = 4000
FIRST_SEED = 10_000  # far from the seeds of the chairs that come with the package
SETTINGS = SceneSettings(size=160, height=(72.0, 132.0))  # as in small photographs, which are hardly enlarged
BATCH = 128
LEARNING_RATE, WEIGHT_DECAY = 2e-3, 0.01  # of AdamW; the rate is the highest of its schedule
SPREAD = 8.0  # degrees: σ of the probabilities around the true azimuth that the network learns


def chairs() -> dict[str, Mesh]:
    """Procedural chairs by name, half of them of each kind in turn, the others of random kinds; no stools.

    A stool looks the same from several sides.
    """
    sys.path.append(str(Path(__file__).parents[1] / "chairs"))
    from chairs import KINDS, chair

    kinds = [kind for each in KINDS if each != "stool" for kind in (each, None)]
    return {f"{k:04d}": chair(FIRST_SEED + k, kinds[k % len(kinds)]) for k in range(CHAIRS)}


def viewpoint_scene(index: int, models: Mapping[str, Mesh], photographs: Sequence[Tensor], seed: int) -> Scene:
    """The scene number ``index``: azimuths are uniform, elevations and tilts mostly those that photographs have.

    In a quarter of the scenes the box is off by a tenth of its sides, a quarter has shadows and highlights, and a
    quarter the traces of JPEG.
    """
    generator = np.random.default_rng([seed, index, 3])
    usual, level = generator.random(2) < (0.7, 0.85)
    elevation = generator.triangular(0, 15, 45) if usual else generator.uniform(-20, 80)
    theta = generator.normal(0, 3) if level else generator.uniform(-45, 45)
    rough, lit, compressed = generator.random(3) < 0.25
    settings = replace(
        SETTINGS,
        box_jitter=0.1 if rough else SETTINGS.box_jitter,
        shadow=0.9 if lit else 0.0,
        gloss=generator.uniform(0, 0.6) if lit else 0.0,
        jpeg=(20.0, 80.0) if compressed else (0.0, 0.0),
    )
    viewpoint = np.array([[generator.uniform(0, 360), elevation, theta]])
    return scene(index, models, viewpoint, photographs, seed=seed, settings=settings)


def described(count: int, photographs: Sequence[Tensor], seed: int) -> tuple[Tensor, Tensor]:
    """Descriptors (N, C, 32, 32) of scenes, float16, and their azimuths (N,), degrees."""
    models = chairs()
    descriptors, azimuths = [], []
    for index in range(count):
        if index % 250 == 0:
            print(f"scene {index} of {count}", flush=True)
        made = viewpoint_scene(index, models, photographs, seed)
        descriptors.append(describe(crop_object(made.image, made.box).image, pose_spec(FINE_CELL)).half())
        azimuths.append(float(made.pose[0]))
    return torch.cat(descriptors), torch.tensor(azimuths)


def likely_azimuths(azimuths: Tensor) -> Tensor:
    """Probabilities (N, 48) of the azimuths 0°, 7.5°, … around those (N,), degrees."""
    apart = (azimuths[:, None].double() - equidistant_azimuths(VIEW_COUNT) + 180) % 360 - 180
    return (-0.5 * (apart / SPREAD).square()).softmax(1).float()


def train(descriptors: Tensor, azimuths: Tensor, epochs: int, seed: int) -> tuple[Tensor, tuple[float, ...]]:
    """Weights (n,), float16, and the mean loss of each epoch: the cross entropy with :func:`likely_azimuths`.

    Half of the scenes, at random, are mirrored.
    """
    batches = len(descriptors) // BATCH
    with seeded(seed):
        network = ViewpointNetwork(descriptors.shape[1], NETWORK_WIDTH).train()
        optimizer = torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, total_steps=epochs * batches)
        losses: list[float] = []
        for epoch in range(epochs):
            total = torch.zeros(())
            for some in torch.randperm(len(descriptors))[: batches * BATCH].reshape(batches, BATCH):
                inputs, flips = descriptors[some].float(), torch.rand(BATCH) < 0.5
                inputs = torch.where(flips[:, None, None, None], mirror_descriptors(inputs), inputs)
                likely = likely_azimuths(torch.where(flips, -azimuths[some], azimuths[some]))
                with torch.autocast("cpu", torch.bfloat16):
                    logits = network(inputs)
                loss = -(likely * logits.float().log_softmax(1)).sum(1).mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()
                total += loss.detach()
            losses.append(float(total) / batches)
            print(f"epoch {epoch + 1} of {epochs}: loss {losses[-1]:.4f}", flush=True)
            if not math.isfinite(losses[-1]):
                raise ValueError("the training diverges")
    fold_statistics(network)
    return flatten_all(network.parameters()).half(), tuple(losses)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, required=True, metavar="DIR", help="photographs behind the chairs")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.npz")
    parser.add_argument("--scenes", type=int, default=70_000, help="at least 128 (default: %(default)s)")
    parser.add_argument("--epochs", type=int, default=18, help="passes over them (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    images = read_folder(options.images, size=512, recursive=True).images
    photographs = [images[name] for name in sorted(images)]
    descriptors, azimuths = described(options.scenes, photographs, options.seed)
    weights, losses = train(descriptors, azimuths, options.epochs, options.seed)
    learning = ViewpointLearning(
        scenes=len(descriptors),
        photographs=len(photographs),
        sha256=digest_of_images(images),
        seed=options.seed,
        epochs=options.epochs,
        losses=losses,
    )
    ViewpointPrior(pose_spec(FINE_CELL), NETWORK_WIDTH, weights, learning).save(options.output)


if __name__ == "__main__":
    main()
