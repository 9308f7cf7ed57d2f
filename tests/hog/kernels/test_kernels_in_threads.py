"""The compiled steps in several threads, their own or the caller's, and in processes that were forked from such."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import torch

from nablahog.hog import hog

from ..zoo import SPECS, noise


@pytest.mark.parametrize("name", ["paper", "uoctti", "opencv", "skimage", "maskfeat"])
def test_threads_change_nothing(name: str) -> None:
    """Neither in a batch nor in one large image: every sum is made in the same order."""
    s, before = SPECS[name], torch.get_num_threads()
    for x in (noise(5, 3, 40, 40, dtype=torch.float32), noise(1, 3, 300, 310, dtype=torch.float32)):
        cotangent, results = noise(*hog(x, s).shape, dtype=torch.float32), []
        x.requires_grad_()
        for threads in (1, 2, 3):
            torch.set_num_threads(threads)
            try:
                descriptor = hog(x, s)
                results.append((descriptor, *torch.autograd.grad(descriptor, x, cotangent)))
            finally:
                torch.set_num_threads(before)
        for one, other in zip(results[0] * 2, results[1] + results[2], strict=True):
            assert torch.equal(one, other)


def test_nan_in_the_rows_of_one_thread_reaches_all() -> None:
    s, before, x = SPECS["uoctti"], torch.get_num_threads(), noise(1, 3, 300, 310, dtype=torch.float32)
    x[0, 2, -1, 0] = torch.nan
    x.requires_grad_()
    torch.set_num_threads(2)
    try:
        descriptor = hog(x, s)
        (grad,) = torch.autograd.grad(descriptor.sum(), x)
    finally:
        torch.set_num_threads(before)
    assert descriptor.isnan().all()
    assert grad.isnan().all()


def test_in_threads_of_the_callers_own() -> None:
    s, images = SPECS["uoctti"], [noise(1, 3, 40, 40, seed=k) for k in range(8)]
    with ThreadPoolExecutor(4) as pool:
        for image, descriptor in zip(images, pool.map(lambda x: hog(x, s), images), strict=True):
            assert torch.equal(descriptor, hog(image, s))


def _in_a_fork(queue: Any) -> None:
    hog(noise(1, 3, 400, 600), SPECS["uoctti"])  # of a new size, whose tables PyTorch computes
    torch.set_num_threads(2)
    queue.put(hog(noise(4, 1, 40, 40), SPECS["uoctti"]).numpy())


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # which threads in general may not survive
def test_in_forked_workers() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        noise(1, 1, 2000, 2000).sqrt()  # OpenMP's threads do not come along, nor do ours
        expected = hog(noise(4, 1, 40, 40), SPECS["uoctti"])
    finally:
        torch.set_num_threads(before)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    worker = context.Process(target=_in_a_fork, args=(queue,))
    worker.start()
    descriptor = torch.from_numpy(queue.get(timeout=60))
    worker.join(timeout=60)
    assert worker.exitcode == 0
    assert torch.equal(descriptor, expected)
