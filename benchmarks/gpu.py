"""The operator on a GPU: tests, times, bandwidth and memory beside its peers; pre-images, priors, and poses.

    python benchmarks/gpu.py [--images DIR] [--only tests hog cosines preimages prior poses] [--json FILE]

Without a GPU it says so and measures nothing.  Where a part fails, its error is printed and the other parts go on.  At
the end stand the goals and what was reached; the exit status is 1 if anything failed or a goal is missed.

Images are float32 in 0…1, on the device already.  Times are of CUDA events: the median of repeated calls and the
quartiles, after calls that are not counted, programs by turns.  Bandwidth counts each byte of the image and of the
descriptor once, as a share of what a copy of 1 GiB reaches on the same device.  Memory is the most that is allocated
during a call beyond the images, in images; the result is part of it.  For the goal the descriptor and its gradient do
not count in a backward pass: the caller holds them.  Waits are those that PyTorch itself warns of in the debug mode
for synchronisation.  All numbers are also written as JSON, to build/gpu.json if no file is named.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, get_args

import torch
from torch import Tensor

from gpu_operator import measure_cosines, measure_hog
from gpu_timing import attempt, judge, milliseconds
from nablahog import hog, presets, reconstruct, train_prior
from nablahog.invert import Search
from nablahog.optimize import Minimiser
from nablahog.paper import chairs
from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose
from photographs import photographs
from timing import cell, digits, summary

PARTS = ("tests", "hog", "cosines", "preimages", "prior", "poses")
TESTS = [
    f"tests/{name}"
    for name in ("hog", "optimize", "invert/test_preimage.py", "invert/test_on_device.py", "render/test_robustness.py")
]
PREIMAGES = 101
VIEWS, VIEW = 64, 128  # of a chair, and their side in pixels
PREIMAGE_SECONDS = 3.0  # the goal
ROOT = Path(__file__).parent.parent


def waits(call: Callable[[], Any]) -> int:
    """How often a call waits for the device."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            call()
        finally:
            torch.cuda.set_sync_debug_mode("default")
    return sum("called a synchronizing" in str(warning.message) for warning in caught)


def measure_preimages(folder: Path | None, report: dict[str, Any]) -> None:
    """101 pre-images of 128 x 128 at once, and how often each minimiser waits for the device."""
    images = photographs(folder)
    images = images.repeat(-(-PREIMAGES // len(images)), 1, 1, 1)[:PREIMAGES].cuda()
    spec = presets.uoctti()
    descriptors = hog(images, spec)
    reconstruct(descriptors[:1], spec, tuple(images.shape[2:]), search=Search(max_evaluations=5))
    torch.cuda.synchronize()
    began = time.perf_counter()
    result = reconstruct(descriptors, spec, tuple(images.shape[2:]))
    torch.cuda.synchronize()
    spent = time.perf_counter() - began
    distance = float(result.distance.mean())
    size = f"{images.shape[2]} × {images.shape[3]}"
    reached = judge(f"{PREIMAGES} pre-images of {size}, s", spent, PREIMAGE_SECONDS, False, report)
    print(f"\n{PREIMAGES} pre-images of {size}: {spent:.2f} s ({reached}), distance {distance:.3g}")
    report["preimages"] = {"seconds": spent, "distance": distance}
    for minimiser in get_args(Minimiser):
        for evaluations in (30, 60):
            few = Search(max_evaluations=evaluations, samples=1, minimiser=minimiser)
            count = waits(partial(reconstruct, descriptors[:8], spec, tuple(images.shape[2:]), search=few))
            print(f"{minimiser}, {evaluations} evaluations: waits {count} times")
            report["preimages"][f"waits {minimiser} {evaluations}"] = count


def measure_prior(folder: Path | None, report: dict[str, Any]) -> None:
    """An epoch of learning, in either precision: the second, as the first compiles."""
    images = {str(k): image[0] for k, image in enumerate(photographs(folder).repeat(64, 1, 1, 1))}
    for precision in ("float32", "bfloat16"):
        train_prior(images, presets.uoctti(), epochs=1, device="cuda", precision=precision)
        torch.cuda.synchronize()
        began = time.perf_counter()
        train_prior(images, presets.uoctti(), epochs=1, device="cuda", precision=precision)
        torch.cuda.synchronize()
        spent = time.perf_counter() - began
        print(f"\nan epoch of the prior, {len(images)} windows, {precision}: {spent:.2f} s")
        report[f"prior {precision}"] = {"windows": len(images), "seconds": spent}


def measure_poses(report: dict[str, Any]) -> None:
    """Views of a chair at once and one by one: images with derivatives by poses, depths and normals."""
    mesh = chairs.chair(3)
    mesh = Mesh(*(part.cuda() for part in (mesh.vertices, mesh.faces, mesh.brightness)))
    camera = Camera.from_field_of_view(30, VIEW, VIEW)
    where = torch.cat([pose(azimuth=360 * k / VIEWS, elevation=20, distance=3) for k in range(VIEWS)]).cuda()
    renderer = Renderer(mesh, camera)

    def images(views: Tensor) -> Tensor:
        views = views.clone().requires_grad_()
        return torch.autograd.grad(renderer(views).sum(), views)[0]

    def depths(views: Tensor) -> Tensor:
        return depth_and_normals(mesh, views, camera)[0]

    def one_by_one(draw: Callable[[Tensor], Tensor]) -> Tensor:
        return torch.cat([draw(view) for view in torch.split(where, 1)])

    for name, draw in (("images and derivatives", images), ("depths and normals", depths)):
        times = milliseconds({"at once": partial(draw, where), "one by one": partial(one_by_one, draw)})
        stats = {how: summary(each) for how, each in times.items()}
        print(f"\n{VIEWS} views of {VIEW}², {name}: " + ", ".join(f"{how} {cell(s)} ms" for how, s in stats.items()))
        report[f"poses {name}"] = stats


def run_tests(report: dict[str, Any]) -> None:
    """All that need a GPU, and those of the kernels."""
    print(flush=True)
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", *TESTS], cwd=ROOT, check=False)
    report["tests"] = done.returncode
    if done.returncode:
        report["failed"].append(f"tests: pytest's exit status is {done.returncode}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, help="photographs of one size, for pre-images and the prior")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "gpu.json")
    args = parser.parse_args()
    if not torch.cuda.is_available():
        print(f"No GPU here: PyTorch {torch.__version__} finds no CUDA device, and nothing was measured.")
        print("Where there is one, with triton and the development tools: python benchmarks/gpu.py")
        sys.exit(1)
    try:
        import triton
    except ModuleNotFoundError:
        print("Triton is not installed, and nothing was measured: pip install 'nablahog[gpu]'")
        sys.exit(1)

    device = torch.cuda.get_device_properties(0)
    versions = f"PyTorch {torch.__version__}, Triton {triton.__version__}"
    print(f"{device.name}, {device.total_memory / 2**30:.0f} GiB, {versions}")
    report: dict[str, Any] = {"device": device.name, "torch": torch.__version__, "triton": triton.__version__}
    report |= {"failed": [], "goals": []}
    warnings.simplefilter("ignore")  # of torch.compile
    parts: dict[str, Callable[[], None]] = {
        "tests": partial(run_tests, report),
        "hog": partial(measure_hog, report),
        "cosines": partial(measure_cosines, report),
        "preimages": partial(measure_preimages, args.images, report),
        "prior": partial(measure_prior, args.images, report),
        "poses": partial(measure_poses, report),
    }
    args.json.parent.mkdir(parents=True, exist_ok=True)
    for name in PARTS:
        if name in args.only:
            attempt(name, parts[name], report)
            args.json.write_text(json.dumps(report))
    print(f"\nall numbers: {args.json}\n\n| goal | | reached | |\n|---|---|---:|---|")
    for goal in report["goals"]:
        limit = f"{'≥' if goal['least'] else '≤'} {goal['goal']:g}"
        print(f"| {goal['what']} | {limit} | {digits(goal['value'])} | {'yes' if goal['reached'] else 'NO'} |")
    for failure in report["failed"]:
        print(f"FAILED: {failure}")
    sys.exit(1 if report["failed"] or not all(goal["reached"] for goal in report["goals"]) else 0)


if __name__ == "__main__":
    main()
