"""What does a mask of the object gain over its box?

    python benchmarks/masks.py [--objects 100] [--seed 24] [--unknown-model]

Scenes are those of `nablahog table2` with procedural chairs and exact boxes; no initial pose is given.  The mask is the
object's silhouette, with gaps narrower than seven pixels closed, as people draw it.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import azimuth_error
from nablahog.paper.models import Meshes, procedural_chairs
from nablahog.paper.scenes import Scene, SceneSettings, scene
from nablahog.paper.viewpoints import sample_viewpoints
from nablahog.pose import estimate_pose
from nablahog.render import Mesh, silhouette

GAP = 7  # pixels
WITHIN = 15.0  # degrees


def mask_of(mesh: Mesh, made: Scene) -> Tensor:
    """(H, W), bool."""
    inside = (silhouette(mesh, made.pose[None], made.camera) > 0.5).float()
    wide = functional.max_pool2d(inside, GAP, 1, GAP // 2)
    return (-functional.max_pool2d(-wide, GAP, 1, GAP // 2))[0, 0] > 0.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--seed", type=int, default=24)
    parser.add_argument("--unknown-model", action="store_true", help="leave an object's own model out")
    options = parser.parse_args()
    torch.set_num_threads(1)
    meshes = Meshes(procedural_chairs(24))
    views = sample_viewpoints(10_000, np.random.default_rng(options.seed))
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    errors: dict[str, list[float]] = {"box": [], "mask": []}
    seconds: dict[str, list[float]] = {"box": [], "mask": []}
    for index in range(options.objects):
        made = scene(index, meshes, views, clutter, seed=options.seed, settings=SceneSettings(box_jitter=0))
        models = {name: meshes[name] for name in meshes if (name == made.model) != options.unknown_model}
        for name, mask in (("box", None), ("mask", mask_of(meshes[made.model], made))):
            began = time.perf_counter()
            estimate = estimate_pose(made.image, models, box=made.box, mask=mask)
            seconds[name].append(time.perf_counter() - began)
            errors[name].append(float(azimuth_error(estimate.azimuth, float(made.pose[0]))))
    print("| given | within 15° | median error | seconds |\n|---|---:|---:|---:|")
    for name, of in errors.items():
        share = np.mean(np.array(of) <= WITHIN)
        print(f"| {name} | {share:.1%} | {np.median(of):.2f}° | {np.median(seconds[name]):.2f} |")


if __name__ == "__main__":
    main()
