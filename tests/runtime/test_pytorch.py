"""Work shared out to threads, random numbers that are the same every time, and a quiet forward mode."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
import torch

from nablahog.runtime import pytorch
from nablahog.runtime.pytorch import _one_thread, by_image, in_threads, memory_for, run_in_threads, seeded, to_float64

pytestmark = pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")  # of forks
needs_fork = pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")


def test_results_come_in_order(two_threads: None) -> None:
    assert in_threads(lambda k: k * k, 7) == [0, 1, 4, 9, 16, 25, 36]
    assert in_threads(lambda k: k, 0) == []


def test_inside_pytorch_has_one_thread_and_outside_as_many_as_before(two_threads: None) -> None:
    assert in_threads(lambda _: torch.get_num_threads(), 4) == [1] * 4
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize("lacks", ["a library", "functions"])
def test_a_pytorch_without_settings_of_threads(two_threads: None, monkeypatch: pytest.MonkeyPatch, lacks: str) -> None:
    def load(path: str) -> object:
        if lacks == "a library":
            raise OSError
        return object()

    monkeypatch.setattr(pytorch, "CDLL", load)
    for cached in (pytorch._thread_settings, pytorch._pool):
        monkeypatch.setattr(pytorch, cached.__name__, cache(cached.__wrapped__))
    assert in_threads(lambda _: torch.get_num_threads(), 4) == [1] * 4
    numbers: list[int] = []
    thread = threading.Thread(target=lambda: numbers.append(torch.get_num_threads()))
    thread.start()
    thread.join()
    assert numbers == [2]


@pytest.mark.parametrize("count", [0, 1, 2, 3, 64])
def test_every_thing_is_in_one_part(two_threads: None, count: int) -> None:
    parts: list[tuple[int, int]] = []
    run_in_threads(lambda _, start, stop, end: parts.append((start, stop)), count, (0,), (1,))
    assert [k for start, stop in sorted(parts) for k in range(start, stop)] == list(range(count))
    assert len(parts) == min(2, count)


def test_the_caller_takes_a_part(two_threads: None) -> None:
    meeting, result = threading.Barrier(2, timeout=20), []

    def work(start: int, stop: int) -> None:
        result.append(threading.current_thread())
        meeting.wait()

    run_in_threads(work, 8)
    assert threading.current_thread() in result
    assert len(set(result)) == 2


def test_new_threads_have_as_many_as_before_while_the_pool_starts(two_threads: None) -> None:
    numbers = []

    def count() -> None:
        numbers.append(torch.get_num_threads())

    def start() -> None:
        _one_thread()
        other = threading.Thread(target=count)
        other.start()
        other.join()
        count()

    thread = threading.Thread(target=start)
    thread.start()
    thread.join()
    assert numbers == [2, 1]


@pytest.mark.parametrize("bad", [0, 7], ids=["the caller's part", "another part"])
def test_errors_of_parts_come_when_all_have_ended(two_threads: None, bad: int) -> None:
    ended = []

    def work(start: int, stop: int) -> None:
        if start <= bad < stop:
            raise ValueError("no")
        time.sleep(0.05)
        ended.append(start)

    with pytest.raises(ValueError, match="no"):
        run_in_threads(work, 8)
    assert len(ended) == 1


def test_memory_of_a_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a GPU with 100 bytes free, and 40 kept by PyTorch, of which tensors take 30."""
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (100, 1000))
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda device: 40)
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda device: 30)
    assert memory_for(torch.device("cuda"), 7, 0.5) == 55
    assert memory_for(torch.device("cpu"), 7, 0.5) == 7


def test_a_device_without_float64_keeps_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    x = torch.rand(3)
    assert to_float64(x).dtype == torch.float64

    def refuse(x: torch.Tensor) -> torch.Tensor:
        raise TypeError("Cannot convert a MPS Tensor to float64 dtype")

    monkeypatch.setattr(torch.Tensor, "double", refuse)
    assert to_float64(x) is x


@pytest.mark.parametrize(("batch", "calls"), [((0, 2), 1), ((3, 2), 3)])
@pytest.mark.parametrize("device", ["cpu", "meta"])
def test_by_image(batch: tuple[int, int], calls: int, device: str) -> None:
    """One at a time on a CPU; at once if there are none, or elsewhere."""
    sizes: list[int] = []

    def double(x: torch.Tensor) -> torch.Tensor:
        sizes.append(len(x))
        return 2 * x

    assert by_image(double, torch.ones(batch, device=device)).shape == batch
    assert len(sizes) == (calls if device == "cpu" else 1)


def run_forked(work: Callable[[], Any]) -> Any:
    """The result of work in a process that is forked for it."""
    context = multiprocessing.get_context("fork")
    results = context.SimpleQueue()
    child = context.Process(target=lambda: results.put(work()))
    child.start()
    child.join(20)
    child.kill()
    assert child.exitcode == 0
    return results.get()


@needs_fork
def test_forked_processes_have_threads_of_their_own(two_threads: None) -> None:
    in_threads(lambda k: k, 3)
    assert run_forked(lambda: in_threads(lambda k: k, 3)) == [0, 1, 2]


def _draw() -> float:
    with seeded(3):
        return float(torch.rand(1))


@needs_fork
def test_a_process_forked_while_another_thread_seeds_can_seed() -> None:
    inside, leave = threading.Event(), threading.Event()

    def hold() -> None:
        with seeded(3):
            inside.set()
            leave.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    inside.wait(30)
    try:
        drawn = run_forked(_draw)
    finally:
        leave.set()
        thread.join()
    assert drawn == _draw()


def test_the_generator_goes_on_as_before() -> None:
    torch.manual_seed(7)
    expected = torch.rand(4)
    torch.manual_seed(7)
    first = torch.rand(2)
    with seeded(3):
        inside = torch.rand(2)
    assert torch.equal(torch.cat([first, torch.rand(2)]), expected)
    with seeded(3):
        assert torch.equal(torch.rand(2), inside)


PROGRAM = """
import warnings, torch, nablahog
from dataclasses import replace
from nablahog.hog.descriptor import histograms_jvp
images, spec = torch.rand(1, 1, 16, 16), replace(nablahog.presets.paper(), mask="sobel", border="zero")
warnings.simplefilter("error")
histograms_jvp(images, images, spec)
"""


@pytest.mark.slow
def test_pytorch_does_not_warn_of_its_own_forward_mode() -> None:
    ended = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
