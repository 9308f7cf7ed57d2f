"""How fast is the operator on a GPU beside its peers, and how long do pre-images, priors and poses take there?

    python benchmarks/gpu.py [--images DIR] [--only tests hog preimages prior poses]

Images are float32 in 0…1, on the device already.  Times are of CUDA events: the median and the quartiles of programs
that take turns.  Bandwidth counts each byte of the image and of the descriptor once, as a share of what a copy of 1 GiB
reaches on the same device.  Memory is the most that is allocated during a call beyond the images, in images; the result
is part of it.  Cosines: from which size on Fourier transforms take less time than products with matrices.  Waits are
those for the device that PyTorch itself warns of.  At the end stand the goals; the exit status is 1 if one is missed,
or a part fails.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import get_args

import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct, train_prior
from nablahog.hog import HOGSpec
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.invert import Search
from nablahog.optimize import Minimiser
from nablahog.render import Camera, Mesh, Renderer, depth_and_normals, pose, sample_chairs
from preimages import photographs
from timing import Call, cell, digits, summary, table

ROOT = Path(__file__).parent.parent
TESTS = ("hog", "optimize", "invert/test_reconstruct.py", "invert/test_minimisers.py", "render/test_robustness.py")
SECONDS = 2.0  # of each program and size
LARGE = 4096
SIZES = ((64, 128), (1, 512), (1, LARGE))
TIMES_PLAIN, BANDWIDTH, IMAGES = 10.0, 0.5, 2.0  # the goals
PREIMAGES, PREIMAGE_SECONDS = 101, 3.0
VIEWS, VIEW = 64, 128  # of a chair, and their side in pixels
goals: list[list[str]] = []
missed: list[str] = []


def judge(what: str, value: float, goal: float, *, least: bool = False) -> None:
    """Notes a goal: the figure is to be at least, or at most, the limit."""
    reached = value >= goal if least else value <= goal
    goals.append([what, f"{'≥' if least else '≤'} {goal:g}", digits(value), "yes" if reached else "**no**"])
    missed.extend([] if reached else [what])


def milliseconds(calls: dict[str, Call]) -> dict[str, list[float]]:
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


def peak(call: Call, images: Tensor) -> float:
    """The most memory during a call beyond what there was before, in images."""
    call()
    torch.cuda.synchronize()
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.memory_allocated()
    result = call()
    torch.cuda.synchronize()
    del result
    return (torch.cuda.max_memory_allocated() - before) / images.nbytes


def with_backward(describe: Callable[[Tensor], Tensor], images: Tensor) -> Tensor:
    """The gradient with respect to the images of a sum of the descriptor."""
    descriptor = describe(images)
    return torch.autograd.grad(descriptor, images, torch.ones_like(descriptor))[0]


def captured(describe: Callable[[Tensor], Tensor], images: Tensor) -> Call:
    """The forward pass as a CUDA graph."""
    describe(images)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        describe(images)
    return graph.replay


def rows_of(name: str, spec: HOGSpec, shape: tuple[int, int], backward: bool, bandwidth: float) -> list[list[str]]:
    """The table's rows of one preset, size and pass."""
    torch.compiler.reset()  # or after eight graphs of one function it stops to compile
    images = torch.rand(shape[0], 1, shape[1], shape[1], device="cuda")
    entries = hog(images, spec).numel()
    images.requires_grad_(backward)
    plain = partial(hog, spec=spec, backend="torch")
    describe: dict[str, Callable[[Tensor], Tensor]] = {
        "Triton": partial(hog, spec=spec, backend="triton"),
        "plain steps": plain,
        "plain steps, torch.compile": torch.compile(plain, dynamic=False),
    }
    calls: dict[str, Call] = {
        program: partial(with_backward, each, images) if backward else partial(each, images)
        for program, each in describe.items()
    }
    if not backward:
        calls["Triton, CUDA graph"] = captured(describe["Triton"], images)
    times = {program: summary(each) for program, each in milliseconds(calls).items()}
    moved = (images.numel() * (2 if backward else 1) + entries) * 4
    where, rows = f"{name}, {shape[0]}×{shape[1]}², {'with backward' if backward else 'forward'}", []
    for program, stats in times.items():
        memory = peak(calls[program], images) if "graph" not in program else None
        share = moved / (1e-3 * stats["median"]) / bandwidth
        if program == "plain steps":
            faster = stats["median"] / times["Triton"]["median"]
            judge(f"{where}: times as fast as the plain steps", faster, TIMES_PLAIN, least=True)
        if program == "Triton" and memory is not None:
            held = 2 * entries * 4 / images.nbytes if backward else 0.0  # by the caller: descriptor and its gradient
            judge(f"{where}: memory but for what the caller holds", memory - held, IMAGES)
            if shape[1] == LARGE and not backward:
                judge(f"{where}: share of the bandwidth", share, BANDWIDTH, least=True)
        rows.append([where, program, cell(stats), f"{share:.0%}", "–" if memory is None else digits(memory)])
    return rows


def measure_hog() -> None:
    """Forward, and forward with backward."""
    bandwidth, rows = copy_bandwidth(), []
    for name in ("paper", "uoctti", "skimage"):
        for shape in SIZES:
            for backward in (False, True):
                rows += rows_of(name, DEFAULT_SPECS[name], shape, backward, bandwidth)
                torch.cuda.empty_cache()
    print(f"A copy reaches {bandwidth / 1e9:.0f} GB/s.\n")
    print(table(["what", "program", "ms", "bandwidth", "memory, images"], rows))


def waits(call: Call) -> int:
    """How often a call waits for the device."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            call()
        finally:
            torch.cuda.set_sync_debug_mode("default")
    return sum("called a synchronizing" in str(warning.message) for warning in caught)


def seconds(call: Call) -> float:
    torch.cuda.synchronize()
    began = time.perf_counter()
    call()
    torch.cuda.synchronize()
    return time.perf_counter() - began


def measure_preimages(folder: Path | None) -> None:
    """All pre-images at once, and how often each minimiser waits for the device."""
    images = photographs(folder)
    images = images.repeat(-(-PREIMAGES // len(images)), 1, 1, 1)[:PREIMAGES].cuda()
    spec, size = presets.uoctti(), (images.shape[2], images.shape[3])
    descriptors = hog(images, spec)
    reconstruct(descriptors[:1], spec, size, prior=None, search=Search(max_evaluations=5))
    judge(
        f"{PREIMAGES} pre-images of {size}, s",
        seconds(lambda: reconstruct(descriptors, spec, size, prior=None)),
        PREIMAGE_SECONDS,
    )
    for minimiser in get_args(Minimiser):
        few = Search(max_evaluations=30, samples=1, minimiser=minimiser)
        count = waits(partial(reconstruct, descriptors[:8], spec, size, prior=None, search=few))
        print(f"{minimiser}, 30 evaluations: waits for the device: {count}")


def measure_prior(folder: Path | None) -> None:
    """An epoch of learning: the second, as the first compiles."""
    images = {str(k): image[0] for k, image in enumerate(photographs(folder).repeat(64, 1, 1, 1))}
    for precision in ("float32", "bfloat16"):
        learn = partial(train_prior, images, presets.uoctti(), epochs=1, device="cuda", precision=precision)
        learn()
        print(f"an epoch of the prior, {len(images)} windows, {precision}: {seconds(learn):.2f} s")


def measure_poses() -> None:
    """Views of a chair at once and one by one: images with derivatives by poses, depths and normals."""
    mesh = sample_chairs()["wooden-0"]
    mesh = Mesh(mesh.vertices.cuda(), mesh.faces.cuda(), mesh.brightness.cuda())
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
        told = ", ".join(f"{how} {cell(summary(each))} ms" for how, each in times.items())
        print(f"{VIEWS} views of {VIEW}², {name}: {told}")


def run_tests() -> None:
    """All that need a GPU, and those of the kernels."""
    subprocess.run([sys.executable, "-m", "pytest", "-q", *(f"tests/{name}" for name in TESTS)], cwd=ROOT, check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, help="photographs of one size, for pre-images and the prior")
    parts: dict[str, Callable[[argparse.Namespace], None]] = {
        "tests": lambda options: run_tests(),
        "hog": lambda options: measure_hog(),
        "preimages": lambda options: measure_preimages(options.images),
        "prior": lambda options: measure_prior(options.images),
        "poses": lambda options: measure_poses(),
    }
    parser.add_argument("--only", nargs="+", choices=parts, default=[*parts])
    options = parser.parse_args()
    if not torch.cuda.is_available():
        sys.exit(f"No GPU here: PyTorch {torch.__version__} finds no CUDA device, and nothing was measured.")
    device = torch.cuda.get_device_properties(0)
    print(f"{device.name}, {device.total_memory / 2**30:.0f} GiB, PyTorch {torch.__version__}")
    warnings.simplefilter("ignore")  # of torch.compile
    for name in options.only:
        print(f"\n## {name}\n", flush=True)
        try:
            parts[name](options)
        except Exception:  # the other parts go on
            traceback.print_exc(file=sys.stdout)
            missed.append(f"{name} failed")
    print(f"\n{table(['goal', 'limit', 'measured', 'reached'], goals)}\n\nmissed: {', '.join(missed) or 'nothing'}")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
