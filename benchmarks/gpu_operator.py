"""The operator on a GPU beside its peers, and cosine transforms; ``gpu.py`` calls these."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor

from gpu_timing import attempt, copy_bandwidth, judge, milliseconds, peak
from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.invert.cosine_transform import by_fourier, by_products
from timing import cell, digits, summary

LARGE = 4096
SIZES = ((64, 128), (1, 512), (1, LARGE))
GRAPH = "Triton, CUDA graph"
TIMES_PLAIN, BANDWIDTH, IMAGES = 10.0, 0.5, 2.0  # the goals


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


def rows_of(name: str, spec: HOGSpec, shape: tuple[int, int], backward: bool, report: dict[str, Any]) -> None:
    """The table's rows of one preset, size and pass."""
    torch.compiler.reset()  # or after eight graphs of one function it stops to compile
    (batch, side), passes = shape, "with backward" if backward else "forward"
    where = f"{name}, {batch} × {side}², {passes}"
    images = torch.rand(batch, 1, side, side, device="cuda")
    numbers = hog(images, spec).numel()
    images.requires_grad_(backward)
    calls: dict[str, Callable[[], Any]] = {}
    for program, describe in programs(spec).items():
        calls[program] = partial(with_backward(describe) if backward else describe, images)
    if not backward:
        graph = attempt(f"{where}, CUDA graph", partial(captured, programs(spec)["Triton"], images), report)
        if graph is not None:
            calls[GRAPH] = graph
    for program in [*calls]:
        before = len(report["failed"])
        attempt(f"{where}, {program}", calls[program], report)
        if len(report["failed"]) > before:
            del calls[program]
    times = {program: summary(each) for program, each in milliseconds(calls).items()}
    moved = (images.numel() * (2 if backward else 1) + numbers) * 4
    for program, stats in times.items():
        memory = peak(calls[program], images) if program != GRAPH else None
        share = moved / (1e-3 * stats["median"]) / report["copy_bytes_per_second"]
        ratio = stats["median"] / times["Triton"]["median"] if "Triton" in times else None
        goals = []
        if program == "plain steps" and ratio is not None:
            goals.append(judge(f"{where}: times as fast as the plain steps", ratio, TIMES_PLAIN, True, report))
        if program == "Triton":
            assert memory is not None
            held = 2 * numbers * 4 / images.nbytes if backward else 0.0  # by the caller: descriptor and its gradient
            goals.append(judge(f"{where}: memory but for what the caller holds", memory - held, IMAGES, False, report))
            if side == LARGE and not backward:
                goals.append(judge(f"{where}: share of the bandwidth", share, BANDWIDTH, True, report))
        print(
            f"| {name} | {batch} × {side}² | {passes} | {program} | {cell(stats)} | "
            f"{'' if ratio is None else f'{ratio:.2f}'} | {share:.0%} | {'' if memory is None else digits(memory)} | "
            f"{'; '.join(goals)} |",
            flush=True,
        )
        row = [name, batch, side, passes, program, stats, share, memory]
        report.setdefault("hog", []).append(row)


def measure_hog(report: dict[str, Any]) -> None:
    """Forward, and forward with backward."""
    bandwidth = report["copy_bytes_per_second"] = copy_bandwidth()
    print(f"\na copy reaches {bandwidth / 1e9:.0f} GB/s\n")
    print("| preset | images | pass | program | ms | times Triton | bandwidth | memory, images | goals |")
    print("|---|---|---|---|---:|---:|---:|---:|---|")
    for name, spec in (("paper", presets.paper()), ("uoctti", presets.uoctti()), ("skimage", presets.skimage())):
        for shape in SIZES:
            for backward in (False, True):
                attempt(f"{name} {shape} {backward}", partial(rows_of, name, spec, shape, backward, report), report)
                torch.cuda.empty_cache()
    attempt("OpenCV", measure_opencv, report)


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
