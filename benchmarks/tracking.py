"""How fast and how exact is the tracker, and when does it notice that the object is gone, and back?

    python benchmarks/tracking.py [--videos 8] [--frames 240] [--seed 0] [--threads 2] [--slow]

Videos of 640x480 pixels are rendered: a procedural chair before a photograph that comes with scikit-image, both moving,
with noise.  In each video the chair is covered for 15 frames, and later leaves the frame for 20 and comes back.  The
tracker knows the model and the focal length; the first frame is searched without a box.  Errors are those of frames in
which the whole chair is seen and the tracker sees it, too; rotations are those of the matrices.  With --slow, motions
are a third as fast.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from nablahog.hog.gradient import gray
from nablahog.io.sample_photographs import SAMPLE_NAMES, sample_photograph
from nablahog.paper.chairs import chair
from nablahog.pose import Tracker
from nablahog.render import Mesh, pose, render
from nablahog.render.rigid import moved_before, pose_matrix, turn_to

HEIGHT, WIDTH, FOCAL = 480, 640, 560.0
COVERED, AWAY = (0.35, 15), (0.65, 20)  # when, as a share of the video, and for how many frames
NOISE = 0.02
WRONG = 15.0  # degrees of rotation from which on a pose counts as wrong


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a video.

    Attributes:
        image: (1, H, W).
        matrix: (4, 4), from the mesh to the camera.
        seen: whether the whole object is.
        hidden: whether nothing of it is.
    """

    image: Tensor
    matrix: Tensor
    seen: bool
    hidden: bool


def video(mesh: Mesh, number: int, seed: int, frames: int, speed: float) -> Iterator[Frame]:
    rng = np.random.default_rng([seed, number])
    behind, before = (gray(sample_photograph(SAMPLE_NAMES[int(k)])[None].float())[0] for k in rng.permutation(8)[:2])
    scale = 1.35 * max(HEIGHT / behind.shape[1], WIDTH / behind.shape[2])
    behind = functional.interpolate(behind[None], scale_factor=scale, mode="bilinear", antialias=True)[0]
    before = functional.interpolate(before[None], (HEIGHT, WIDTH), mode="bilinear", antialias=True)[0]
    phases, start = rng.uniform(0, 2 * math.pi, 6), rng.uniform(0, 360)
    covered, away = (range(int(share * frames), int(share * frames) + count) for share, count in (COVERED, AWAY))
    room = [behind.shape[1] - HEIGHT, behind.shape[2] - WIDTH]
    for k in range(frames):
        waves = [
            math.sin(2 * math.pi * speed * k / period + phase)
            for period, phase in zip((150, 97, 120, 88, 110, 75), phases, strict=True)
        ]
        out = 0.0
        if away.start - 12 <= k < away.stop + 12:  # twelve frames to leave, and to come back
            out = min((k - away.start + 12) / 12, (away.stop + 12 - k) / 12, 1.0)
        turn = pose_matrix(pose(start + 70 * waves[0], 20 + 12 * waves[1], 2.9 + 0.5 * waves[2], 4 * waves[3])[0])
        across, down = 0.22 * waves[4] + 0.95 * out, 0.12 * waves[5]
        matrix = torch.eye(4, dtype=torch.float64)
        matrix[:3] = turn_to(torch.tensor([across, down, 1.0], dtype=torch.float64)).T @ turn[:3]
        intrinsics = torch.tensor([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]], dtype=torch.float64)
        top, left = (int(side * (0.5 + 0.5 * wave)) for side, wave in zip(room, (waves[5], waves[4]), strict=True))
        part = behind[:, top : top + HEIGHT, left : left + WIDTH]
        image = render(*moved_before(mesh, matrix, intrinsics, HEIGHT, WIDTH), background=part[None], supersampling=2)[
            0
        ]
        if k in covered:
            image = before
        noise = torch.from_numpy(rng.normal(0, NOISE, image.shape)).float()
        hidden = k in covered or k in away
        yield Frame((image + noise).clamp(0, 1), matrix, not hidden and out == 0, hidden)


def degrees_between(one: Tensor, other: Tensor) -> float:
    cosine = (float((one[:3, :3] @ other[:3, :3].T).trace()) - 1) / 2
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--videos", type=int, default=8)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--slow", action="store_true")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    seconds: list[float] = []
    searched: list[float] = []
    errors: list[float] = []
    noticed: list[int] = []
    again: list[int] = []
    missed = seen = false = hidden = 0
    print(
        "| chair | ms a frame, median / slowest followed | error, median / 90th | frames until noticed | until found |"
    )
    print("|---:|---:|---:|---:|---:|")
    for number in range(options.videos):
        mesh = chair(100 + number)
        tracker = Tracker(mesh, focal=FOCAL, seed=options.seed)
        own: list[float] = []
        wrong: list[float] = []
        changes: list[list[int]] = [[], []]
        gone_at = back_at = -1
        before = None
        for k, frame in enumerate(video(mesh, number, options.seed, options.frames, 1 / 3 if options.slow else 1.0)):
            lost = tracker.lost
            began = time.perf_counter()
            estimate = tracker(frame.image)
            took = time.perf_counter() - began
            (searched if k == 0 or lost or tracker.lost else own).append(took)
            if before is not None and frame.hidden != before.hidden:
                gone_at, back_at = (k, -1) if frame.hidden else (-1, k)
            if gone_at >= 0 and estimate is None:
                changes[0].append(k - gone_at)
                gone_at = -1
            if back_at >= 0 and frame.seen and estimate is not None:
                error = degrees_between(estimate.matrix(), frame.matrix)
                if error <= WRONG:
                    changes[1].append(k - back_at)
                    back_at = -1
            if frame.seen:
                seen += 1
                missed += estimate is None
                if estimate is not None:
                    wrong.append(degrees_between(estimate.matrix(), frame.matrix))
            if frame.hidden:
                hidden += 1
                false += estimate is not None
            before = frame
        own = own or [math.nan]
        times = f"{1e3 * np.median(own):.0f} / {1e3 * max(own):.0f}"
        off = f"{np.median(wrong):.2f}° / {np.percentile(wrong, 90):.2f}°"
        print(f"| {100 + number} | {times} | {off} | {changes[0]} | {changes[1]} |", flush=True)
        seconds, errors, noticed, again = seconds + own, errors + wrong, noticed + changes[0], again + changes[1]
    print(f"\nfollowed: {1 / np.median(seconds):.0f} frames a second, slowest {1e3 * max(seconds):.0f} ms")
    times = f"median {1e3 * np.median(searched):.0f} ms, slowest {1e3 * max(searched):.0f} ms"
    print(f"lost or searching: {times}, {len(searched)} frames")
    shares = f"{np.mean(np.array(errors) <= WRONG):.1%} within {WRONG:g}°"
    print(
        f"rotation error: median {np.median(errors):.2f}°, 90th percentile {np.percentile(errors, 90):.2f}°, {shares}"
    )
    print(f"frames until noticed {sorted(noticed)}; until found again {sorted(again)}")
    print(f"seen, but not by the tracker: {missed} of {seen} frames; hidden, but seen by it: {false} of {hidden}")


if __name__ == "__main__":
    main()
