"""Where the paper's search is wrong and its baseline was right: is the similarity's maximum wrong, or not reached?

    python benchmarks/pose_failures.py [--models DIR] [--viewpoints CSV] [--objects 60] [--seed 0] [--threads 1]
        [--unknown-model] [--exemplars DIR]

The objects are those of `nablahog table2` with the same options.  The search, from the baseline's model and pose, is
compared with a grid: each degree of azimuth at the same elevation, once placed so that the object fills its box, as
the search begins, and once at the distance and place at which the search ended.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from nablahog.metrics import VIEWS, same_view
from nablahog.paper.examples import Example
from nablahog.paper.pose_methods import PoseInput, Table2Settings, detection
from nablahog.pose import estimate_pose
from nablahog.pose.crop import crop_object
from nablahog.pose.estimate import EVERY_DEGREE, PAPER_RENDERERS
from nablahog.pose.options import SearchMethod
from nablahog.pose.placement import azimuth_sweep, equidistant_azimuths, fit_to_box, level_poses
from nablahog.pose.prepared import PreparedPhotograph, prepared_model
from poses import add_options, objects_of

ASKED = (4, 24)  # views of the failures


def azimuths(
    example: Example, method: SearchMethod, settings: Table2Settings
) -> tuple[float, float, float, float] | None:
    """The azimuths of the baseline, of the search, of the grid's maximum, and of the best of both; or no detection."""
    meshes = {model.name: model.mesh() for model in example.models}
    try:
        start = detection(PoseInput(example.image, example.box, meshes, example.initial), settings)
    except ValueError:
        return None
    mesh = meshes[start.model]
    initial = start.azimuth, start.elevation
    search = estimate_pose(example.image, mesh, box=example.box, initial=initial, method=method)
    crop = crop_object(example.image, example.box)
    model = prepared_model(mesh, crop.camera)
    similarity = model.similarity(PreparedPhotograph(crop).patches, *PAPER_RENDERERS[method])
    level = level_poses(equidistant_azimuths(EVERY_DEGREE), start.elevation)
    poses = torch.cat(
        [fit_to_box(level, model.hull, crop.camera, crop.size), azimuth_sweep(search.crop_pose, EVERY_DEGREE)]
    )
    values = similarity.values(poses)
    fitted = float(poses[values[:EVERY_DEGREE].argmax(), 0])
    highest = search.azimuth if search.similarity >= values.max() else float(poses[values.argmax(), 0])
    return start.azimuth, search.azimuth, fitted, highest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_options(parser, threads=1)
    parser.add_argument("--exemplars", type=Path, help="folder of the baseline's views, as `nablahog learn exemplars`")
    options = parser.parse_args()
    settings = Table2Settings(options.seed, options.exemplars)
    torch.set_num_threads(options.threads)
    examples = objects_of(options)
    print(f"{len(examples)} objects, seed {options.seed}; in percent of these by interval\n")
    print("| method | azimuth of | " + " | ".join(f"{views} views" for views in VIEWS) + " |")
    print("|---|---|" + "---:|" * len(VIEWS))
    counts = []
    for method in PAPER_RENDERERS:
        of = [(example.azimuth, azimuths(example, method, settings)) for example in examples]
        found = [(true, *each) for true, each in of if each is not None]
        right = {views: [[bool(same_view(one, row[0], views)) for one in row[1:]] for row in found] for views in VIEWS}
        for column, name in enumerate(("the baseline", "the search", "the grid's maximum", "the highest of all")):
            shares = (100 * sum(row[column] for row in right[views]) / len(examples) for views in VIEWS)
            print(f"| {method} | {name} | {' | '.join(f'{share:.1f}' for share in shares)} |", flush=True)
        for views in ASKED:
            lost = [highest for start, search, _, highest in right[views] if start and not search]
            won = sum(search and not start for start, search, _, _ in right[views])
            counts.append((method, views, len(lost), len(lost) - sum(lost), sum(lost), won))
    print("\n| method | views | baseline right, search wrong | maximum wrong | not reached | search right alone |")
    print("|---|---:|---:|---:|---:|---:|")
    for row in counts:
        print(f"| {' | '.join(map(str, row))} |")


if __name__ == "__main__":
    main()
