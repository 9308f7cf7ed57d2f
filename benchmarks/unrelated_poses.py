"""What similarity do models find in photographs of something else?

    python benchmarks/unrelated_poses.py [--scenes N] [--models N] [--json FILE]

Quantiles of the similarity that `nablahog pose` reports where the object is one of the models, where it is another
chair, and in boxes of photographs without any chair.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from nablahog import estimate_pose
from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.paper.examples import rendered
from nablahog.paper.models import procedural_chairs
from nablahog.paper.viewpoints import sample_viewpoints
from nablahog.pose.options import SimilarityKind

SIDE = 150  # pixels of the shortest side of a box without the object
QUANTILES = (0.0, 0.1, 0.5, 0.9, 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=24, help="of each kind (default: 24)")
    parser.add_argument("--models", type=int, default=6, help="chairs that are tried (default: 6)")
    parser.add_argument("--similarity", default="calibrated", help="(default: calibrated)")
    parser.add_argument("--json", type=Path, help="write all similarities to this file, too")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    models = procedural_chairs(options.models)
    views = sample_viewpoints(10_000, np.random.default_rng(0))
    found: dict[str, list[float]] = {}

    def add(kind: str, image: object, meshes: object, box: object) -> None:
        similarity: SimilarityKind = options.similarity
        estimate = estimate_pose(image, meshes, box=box, similarity=similarity)  # type: ignore[arg-type]
        found.setdefault(kind, []).append(estimate.similarity)
        print(kind, f"{estimate.similarity:.2f}", flush=True)

    for unknown, kind in ((False, "its own model among them"), (True, "other chairs only")):
        scenes = rendered(options.scenes, models, views, clutter, origin="", unknown_model=unknown, seed=0)
        for scene in scenes.objects:
            add(kind, scene.image, {each.name: each.mesh() for each in scene.models}, scene.box)
    meshes = {each.name: each.mesh() for each in models}
    for k in range(options.scenes):
        image = clutter[k % len(clutter)]
        height, width = image.shape[1:]
        down, across = (int(rng.integers(SIDE, side + 1)) for side in (height, width))
        top, left = int(rng.integers(height - down + 1)), int(rng.integers(width - across + 1))
        add("no chair", image, meshes, (left, top, left + across, top + down))
    print(f"\n| similarity, {options.similarity} | n | " + " | ".join(f"{q:.0%}" for q in QUANTILES) + " |")
    print("|---" * (2 + len(QUANTILES)) + "|")
    for kind, values in found.items():
        print(f"| {kind} | {len(values)} | " + " | ".join(f"{v:.2f}" for v in np.quantile(values, QUANTILES)) + " |")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
