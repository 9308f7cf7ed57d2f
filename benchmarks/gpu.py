"""The operator on a GPU: tests, times, bandwidth and memory beside its peers; pre-images, priors, and poses.

    python benchmarks/gpu.py [--images DIR] [--only tests hog cosines preimages prior poses] [--json FILE]

Without a GPU it says so and measures nothing.  Images are float32 in 0…1, on the device already.  Times are of CUDA
events: the median of repeated calls and the quartiles, after calls that are not counted, programs by turns.  Bandwidth
counts each byte of the image and of the descriptor once, as a share of what a copy of 1 GiB reaches on the same device.
Memory is the most that is allocated during a call beyond the images, in images; the result is part of it.
Waits are those that PyTorch itself warns of in the synchronisation debug mode.
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

from nablahog import datasets, hog, presets, reconstruct, train_prior
from nablahog.hog import HOGSpec
from nablahog.invert import Search
from nablahog.invert.cosine_transform import by_fourier, by_products
from nablahog.optimize import Minimiser
from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose
from photographs import photographs
from timing import cell, digits, summary

SIZES = ((64, 128), (1, 512), (1, 4096))
PARTS = ("tests", "hog", "cosines", "preimages", "prior", "poses")
TESTS = [
    f"tests/{name}"
    for name in ("hog", "optimize", "invert/test_preimage.py", "invert/test_on_device.py", "render/test_robustness.py")
]
PREIMAGES = 101
VIEWS, VIEW = 64, 128  # of a chair, and their side in pixels
SECONDS = 2.0  # of each program and size
ROOT = Path(__file__).parent.parent


def milliseconds(calls: dict[str, Callable[[], Any]]) -> dict[str, list[float]]:
    """Times of programs that take turns."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        for _ in range(3):
            call()
    torch.cuda.synchronize()
    end = time.perf_counter() + SECONDS * len(calls)
    while time.perf_counter() < end or min(map(len, times.values())) < 5:
        for name, call in calls.items():
            began, ended = (torch.cuda.Event(enable_timing=True) for _ in range(2))
            began.record()
            call()
            ended.record()
            ended.synchronize()
            times[name].append(began.elapsed_time(ended))
    return times


def copy_bandwidth() -> float:
    """Bytes a second that a copy reads and writes."""
    source = torch.empty(2**30, dtype=torch.uint8, device="cuda")
    target = torch.empty_like(source)
    times = milliseconds({"copy": lambda: target.copy_(source)})["copy"]
    return 2 * source.numel() / (1e-3 * summary(times)["median"])


def peak(call: Callable[[], Any], images: Tensor) -> float:
    """The most memory during a call beyond what there was before, in images."""
    call()
    torch.cuda.synchronize()
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated()
    result = call()
    torch.cuda.synchronize()
    del result
    return (torch.cuda.max_memory_allocated() - before) / images.nbytes


def with_backward(describe: Callable[[Tensor], Tensor]) -> Callable[[Tensor], Tensor]:
    """Its result and the gradient of the images from a gradient of ones."""

    def both(images: Tensor) -> Tensor:
        descriptor = describe(images)
        return torch.autograd.grad(descriptor, images, torch.ones_like(descriptor))[0]

    return both


def programs(spec: HOGSpec) -> dict[str, Callable[[Tensor], Tensor]]:
    """The operator and its peers."""

    def plain(images: Tensor) -> Tensor:
        return hog(images, spec, backend="torch")

    return {
        "Triton": lambda images: hog(images, spec, backend="triton"),
        "plain steps": plain,
        "plain steps, torch.compile": torch.compile(plain, dynamic=False),
    }


def captured(describe: Callable[[Tensor], Tensor], images: Tensor) -> Callable[[], None]:
    """The forward pass as a CUDA graph."""
    describe(images)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        describe(images)
    return graph.replay


def measure_hog(report: dict[str, Any]) -> None:
    """Forward, and forward with backward."""
    bandwidth = copy_bandwidth()
    report["copy_bytes_per_second"] = bandwidth
    print(f"\na copy reaches {bandwidth / 1e9:.0f} GB/s\n")
    print("| preset | images | pass | program | ms | times Triton | bandwidth | memory, images |")
    print("|---|---|---|---|---:|---:|---:|---:|")
    for name, spec in (("paper", presets.paper()), ("uoctti", presets.uoctti()), ("skimage", presets.skimage())):
        for batch, side in SIZES:
            images = torch.rand(batch, 1, side, side, device="cuda")
            numbers = hog(images, spec).numel()
            for backward in (False, True):
                images.requires_grad_(backward)
                calls: dict[str, Callable[[], Any]] = {}
                for program, describe in programs(spec).items():
                    whole = with_backward(describe) if backward else describe
                    calls[program] = partial(whole, images)
                if not backward:
                    calls["Triton, CUDA graph"] = captured(programs(spec)["Triton"], images)
                try:
                    times = milliseconds(calls)
                except torch.OutOfMemoryError:
                    calls = {"Triton": calls["Triton"]}
                    times = milliseconds(calls)
                ours = summary(times["Triton"])["median"]
                moved = (images.numel() * (2 if backward else 1) + numbers) * 4
                for program, each in times.items():
                    stats, memory = summary(each), peak(calls[program], images)
                    share = moved / (1e-3 * stats["median"]) / bandwidth
                    passes = "with backward" if backward else "forward"
                    print(
                        f"| {name} | {batch} × {side}² | {passes} | {program} | {cell(stats)} | "
                        f"{stats['median'] / ours:.2f} | {share:.0%} | {digits(memory)} |"
                    )
                    row = [name, batch, side, passes, program, stats, share, memory]
                    report.setdefault("hog", []).append(row)
    measure_opencv()


def measure_opencv() -> None:
    """OpenCV's class for CUDA, of its one dialect, where there is a build with it."""
    try:
        import cv2

        there = cv2.cuda.getCudaEnabledDeviceCount() > 0 and hasattr(cv2.cuda, "HOG")
    except (ImportError, AttributeError):
        there = False
    if not there:
        print("\nOpenCV here has no HOG for CUDA: not measured")
        return
    for side in (128, 512, 4096):
        image = getattr(cv2, "cuda_GpuMat")()  # noqa: B009  (a build without CUDA has neither)
        image.upload((torch.rand(side, side) * 255).byte().numpy())
        window = getattr(cv2.cuda, "HOG_create")((side, side), (16, 16), (8, 8), (8, 8), 9)  # noqa: B009
        times = milliseconds({"OpenCV": partial(window.compute, image)})["OpenCV"]
        print(f"\nOpenCV's cv2.cuda.HOG, one image of {side}², uint8: {cell(summary(times))} ms")


def measure_cosines(report: dict[str, Any]) -> None:
    """From which size on Fourier transforms take less time than products with matrices."""
    print("\n| cosine transform | dtype | products, ms | Fourier, ms |\n|---|---|---:|---:|")
    for dtype in (torch.float32, torch.float64):
        for batch, side in ((64, 64), (64, 128), (64, 256), (16, 512), (4, 1024), (1, 2048), (1, 4096)):
            planes = torch.rand(batch, 1, side, side, device="cuda", dtype=dtype)
            ways: dict[str, Callable[[], Any]] = {
                "products": partial(by_products, planes, False),
                "Fourier": partial(by_fourier, planes, False),
            }
            stats = {name: summary(each) for name, each in milliseconds(ways).items()}
            print(f"| {batch} × {side}² | {dtype} | {cell(stats['products'])} | {cell(stats['Fourier'])} |")
            report.setdefault("cosines", []).append([batch, side, str(dtype), stats])


def waits(call: Callable[[], Any]) -> int:
    """How often a call waits for the device."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            call()
        finally:
            torch.cuda.set_sync_debug_mode("default")
    return sum("synchroniz" in str(warning.message) for warning in caught)


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
    print(f"\n{PREIMAGES} pre-images of {images.shape[2]} × {images.shape[3]}: {spent:.2f} s, distance {distance:.3g}")
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
    mesh = datasets.chairs.chair(3)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, help="photographs of one size, for pre-images and the prior")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    if not torch.cuda.is_available():
        print(f"No GPU here: PyTorch {torch.__version__} finds no CUDA device, and nothing was measured.")
        print("Where there is one, with triton and the development tools: python benchmarks/gpu.py")
        sys.exit(1)
    import triton

    device = torch.cuda.get_device_properties(0)
    versions = f"PyTorch {torch.__version__}, Triton {triton.__version__}"
    print(f"{device.name}, {device.total_memory / 2**30:.0f} GiB, {versions}")
    report: dict[str, Any] = {"device": device.name, "torch": torch.__version__, "triton": triton.__version__}
    warnings.simplefilter("ignore")  # of torch.compile
    if "tests" in args.only:
        print(flush=True)
        done = subprocess.run([sys.executable, "-m", "pytest", "-q", *TESTS], cwd=ROOT, check=False)
        report["tests"] = done.returncode
    if "hog" in args.only:
        measure_hog(report)
    if "cosines" in args.only:
        measure_cosines(report)
    if "preimages" in args.only:
        measure_preimages(args.images, report)
    if "prior" in args.only:
        measure_prior(args.images, report)
    if "poses" in args.only:
        measure_poses(report)
    if args.json:
        args.json.write_text(json.dumps(report))


if __name__ == "__main__":
    main()
