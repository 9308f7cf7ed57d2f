"""Follows a chair of a known model through the frames of a video: each search begins at the pose of the frame before.

    python examples/track.py

Prints the true azimuth and the estimated one of each frame.  A frame without the object has a low confidence: there
the next one is searched all around again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import torch
from torch import Tensor

import nablahog

WITHIN = 20.0  # degrees of azimuth that an object turns from frame to frame, at most
SURE = 0.8  # confidence below which the object counts as lost: from there on it is looked for everywhere
MARGIN = 0.2  # of the box's sides, that the object may move from frame to frame


def track(frames: Iterable[Tensor], mesh: nablahog.Mesh, focal: float) -> Iterator[nablahog.PoseEstimate]:
    """The pose in each frame (C, H, W), by a camera whose focal length is ``focal`` pixels."""
    last: nablahog.PoseEstimate | None = None
    for frame in frames:
        if last is None:
            estimate = nablahog.estimate_pose(frame, mesh, focal=focal)
        else:
            initial = last.azimuth, last.elevation
            box = around(last, mesh)
            estimate = nablahog.estimate_pose(frame, mesh, box=box, initial=initial, within=WITHIN, focal=focal)
        last = estimate if (estimate.confidence or 0.0) >= SURE else None
        yield estimate


def around(estimate: nablahog.PoseEstimate, mesh: nablahog.Mesh) -> list[float]:
    """x0, y0, x1, y1 around the model at an estimated pose, a little larger."""
    points = (mesh.vertices - mesh.from_original[:3, 3]) @ torch.linalg.inv(mesh.from_original[:3, :3]).T
    matrix = estimate.matrix()
    seen = (points @ matrix[:3, :3].T + matrix[:3, 3]) @ estimate.intrinsics.T
    seen = seen[:, :2] / seen[:, 2:]
    low, high = seen.amin(0), seen.amax(0)
    return torch.cat([low - MARGIN * (high - low), high + MARGIN * (high - low)]).tolist()


if __name__ == "__main__":
    chair, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 240, 320)
    true = torch.tensor([[40.0 + 3 * k, 15, 3, 0, 2 * k, 0] for k in range(8)])
    video = nablahog.render(chair, true, camera)
    for pose, estimate in zip(true, track(video, chair, camera.focal), strict=True):
        print(f"azimuth {float(pose[0]):.0f}°: {estimate}")
