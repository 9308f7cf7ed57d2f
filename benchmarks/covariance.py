"""Is the truth within one standard deviation of 68 % of poses, in each parameter?

    python benchmarks/covariance.py [--models DIR] [--objects 150] [--seed 13] [--condition sides-10] [--height 100 140]

Scenes of known models, so many of each of two renderers, searched with and without their focal length.  The table has
the shares of parameters that are within one standard deviation of the true ones, and, after the slash, within two:
68 and 95 % of a normal distribution.  They are of the poses that are right, whose rotation is off by at most 15°.
x, y and z are those of the position along the camera's axes; the last column is the share of poses within the ellipsoid
that holds 68 % of a normal distribution.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.stats import chi2

from nablahog import estimate_pose, sample_chairs
from nablahog.io.images import SAMPLE_NAMES, sample_photograph
from nablahog.metrics import rotation_error
from nablahog.paper.annotations import sample_viewpoints
from nablahog.paper.examples import CONDITIONS, PLAIN
from nablahog.paper.scenes import Scene, scene
from nablahog.pose import PoseEstimate
from nablahog.render import PARAMETERS, Mesh
from nablahog.render.models import check_models, read_models
from poses import WITHIN
from timing import table

RENDERERS = {"plain": PLAIN.settings, "shadows, highlights, JPEG": CONDITIONS["renderer"].settings}
BOXES = [name for name, condition in CONDITIONS.items() if condition.of_photographs]
COLUMNS = (*PARAMETERS, "position x", "y", "z", "ellipsoid")


def ratios(scene_: Scene, estimate: PoseEstimate) -> np.ndarray | None:
    """Errors in standard deviations, and the root of the squared Mahalanobis distance over its 68 % quantile.

    None of a pose that is wrong; NaN where a standard deviation is infinite.
    """
    azimuths = torch.tensor([estimate.azimuth, *estimate.equivalent_azimuths], dtype=torch.float64)
    nearest = azimuths[((azimuths - scene_.pose[0] + 180) % 360 - 180).abs().argmin()]
    error = estimate.pose[0] - scene_.pose
    error[0] = nearest - scene_.pose[0]
    error[[0, 3]] = (error[[0, 3]] + 180) % 360 - 180
    found = [float(nearest), estimate.elevation, estimate.theta]
    if float(rotation_error([found], scene_.pose[[0, 1, 3]].tolist()).min()) > WITHIN:
        return None
    assert estimate.covariance is not None
    deviations = estimate.covariance.diagonal().sqrt()
    finite = deviations.isfinite()
    inverse = torch.linalg.inv(estimate.covariance[finite][:, finite])
    mahalanobis = float(error[finite] @ inverse @ error[finite]) / chi2.ppf(0.6827, int(finite.sum()))
    position = torch.full((3,), torch.nan, dtype=torch.float64)
    if estimate.position_std is not None:
        true = replace(estimate, **dict(zip(PARAMETERS, scene_.pose.tolist(), strict=True)))
        position = (estimate.position - true.position) / estimate.position_std
    each = torch.where(finite, error / deviations, torch.nan)
    return torch.cat([each, position, torch.tensor([mahalanobis]).sqrt()]).abs().numpy()


def scenes(models: dict[str, Mesh], renderer: str, options: argparse.Namespace) -> Iterator[Scene]:
    viewpoints = sample_viewpoints(10_000, np.random.default_rng(options.seed))
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    size = max(PLAIN.settings.size, round(1.6 * options.height[1]))
    settings = replace(RENDERERS[renderer], height=tuple(options.height), size=size)
    for index in range(options.objects):
        yield scene(index, models, viewpoints, clutter, seed=options.seed, settings=settings)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, help="folder of CAD models; by default chairs that ship")
    parser.add_argument("--objects", type=int, default=150, help="of each renderer")
    parser.add_argument("--seed", type=int, default=13)
    parser.add_argument("--condition", choices=BOXES, help="of the boxes; by default jittered")
    parser.add_argument("--height", type=float, nargs=2, default=PLAIN.settings.height, help="of objects, pixels")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    chairs = check_models(read_models(options.models)[0])[0] if options.models else None
    models = dict(sample_chairs()) if chairs is None else {model.name: model.mesh() for model in chairs}
    rows = []
    for renderer in RENDERERS:
        measured: dict[str, list[np.ndarray]] = {"known": [], "assumed": []}
        for index, one in enumerate(scenes(models, renderer, options)):
            example = one.annotated(str(index))
            if options.condition:
                example = CONDITIONS[options.condition].apply(example, options.seed, index)
            middle = one.camera.width / 2
            axis = middle + float(one.pose[4]), middle + float(one.pose[5])  # of a camera that looks at the object
            lenses: dict[str, dict[str, Any]] = {
                "known": {"focal": one.camera.focal, "principal_point": axis},
                "assumed": {},
            }
            for focal, lens in lenses.items():
                errors = ratios(one, estimate_pose(example.image, models[one.model], box=example.box, **lens))
                measured[focal] += [] if errors is None else [errors]
        for focal, all_errors in measured.items():
            columns = [column[~np.isnan(column)] for column in np.array(all_errors).T]
            shares = [f"{100 * (c <= 1).mean():.0f} / {100 * (c <= 2).mean():.0f}" if len(c) else "–" for c in columns]
            rows.append([f"{renderer}; focal length {focal}", str(len(all_errors)), *shares])
    print(table(["renderer", "right", *COLUMNS], rows))


if __name__ == "__main__":
    main()
