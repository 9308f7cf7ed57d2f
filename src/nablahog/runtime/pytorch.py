"""What the package asks of PyTorch itself: threads, memory, random numbers, forward mode."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from ctypes import CDLL
from functools import cache, lru_cache, wraps
from itertools import pairwise
from typing import Any, ParamSpec, TypeVar

import torch
from torch.autograd import forward_ad

Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")


def in_threads(work: Callable[[int], Result], count: int) -> list[Result]:
    """``work(0)`` … ``work(count - 1)``, in as many threads as PyTorch takes; for loops that release Python's lock.

    Inside ``work`` PyTorch takes one thread: several pools would wait for each other with busy processors, and its sums
    are the same however many threads it takes outside.
    """
    threads = torch.get_num_threads()
    if threads == 1:
        return [work(k) for k in range(count)]
    return list(_pool(threads).map(work, range(count)))


def run_in_threads(
    loop: Callable[..., None], count: int, before: tuple[Any, ...] = (), after: tuple[Any, ...] = ()
) -> None:
    """Calls ``loop(*before, start, stop, *after)`` for equal parts of ``range(count)``, one a thread.

    The caller's thread takes one of them.  For loops that call nothing of PyTorch.
    """
    threads = torch.get_num_threads()
    parts = min(threads, count)
    if parts < 2:
        if count:
            loop(*before, 0, count, *after)
        return
    ends = [count * k // parts for k in range(1, parts + 1)]
    futures = [_pool(threads).submit(loop, *before, *ends_of_part, *after) for ends_of_part in pairwise(ends)]
    try:
        loop(*before, 0, ends[0], *after)
    finally:
        wait(futures)
    for future in futures:
        future.result()


@lru_cache
def _pool(threads: int) -> ThreadPoolExecutor:
    pool = ThreadPoolExecutor(threads, "nablahog", initializer=_one_thread)
    started = threading.Barrier(threads)
    list(pool.map(lambda _: started.wait(), range(threads)))
    if not _thread_settings():
        torch.set_num_threads(threads)  # the pool's threads have changed the part of the setting that is global
    return pool


def _one_thread() -> None:
    torch.get_num_threads()  # its first call in a thread sets the number to the global one
    for set_number in _thread_settings() or (torch.set_num_threads,):
        set_number(1)


@cache
def _thread_settings() -> tuple[Callable[[int], object], ...]:
    """What sets the number of threads for the calling thread alone, in the libraries that PyTorch computes with.

    ``torch.set_num_threads`` sets that of all new threads, too.  Empty if a build of PyTorch has no such functions.
    """
    names = ["omp_set_num_threads", *["MKL_Set_Num_Threads_Local"] * torch._C.has_mkl]
    try:
        library = CDLL(torch._C.__file__)  # whose functions include those of all libraries that it is linked with
        return tuple(getattr(library, name) for name in names) if torch._C.has_openmp else ()
    except (OSError, AttributeError):
        return ()


def _after_fork() -> None:
    """A forked process has the pools of its parent, OpenMP's too, without their threads, and would wait."""
    global _seeding
    _seeding = threading.RLock()  # another thread of the parent may have held it
    _pool.cache_clear()
    torch.set_num_threads(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def to_float64(x: torch.Tensor) -> torch.Tensor:
    """In float64; as it is on a device that has none, such as Apple's GPU."""
    if torch.compiler.is_compiling():
        return x.double()
    try:
        return x.double()
    except TypeError:
        return x


def memory_for(device: torch.device, on_cpu: int, share: float) -> int:
    """Bytes that one part of a batch may take: a share, 0…1, of what is free on a CUDA device, or of others ``on_cpu``.

    What PyTorch keeps without use counts as free.  Asked once for a batch: the driver is slow to answer.
    """
    if device.type != "cuda":
        return on_cpu
    free, _ = torch.cuda.mem_get_info(device)
    unused = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return int(share * (free + unused))


def by_image(function: Callable[..., torch.Tensor], *batches: torch.Tensor) -> torch.Tensor:
    """``function(*batches)``; on a CPU of each image alone: PyTorch rounds a number by its place in a batch."""
    if not batches[0].is_cpu:
        return function(*batches)
    # the derivative of a slice is a whole batch of zeros, that of a part of a split is not
    return torch.cat([function(*images) for images in zip(*(torch.split(batch, 1) for batch in batches), strict=True)])


_seeding = threading.RLock()


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Seeds PyTorch's generators of all devices; afterwards they go on as before.

    Another thread that asks for this waits meanwhile: threads share these generators.
    """
    # devices by name, because PyTorch warns of more than one that is not
    with _seeding, torch.random.fork_rng(devices=range(torch.cuda.device_count())):
        torch.manual_seed(seed)
        yield


@contextmanager
def in_float32() -> Iterator[None]:
    """Makes tensors and modules in float32 whatever PyTorch's default dtype is, which is that of all threads."""
    default = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)
    try:
        yield
    finally:
        torch.set_default_dtype(default)


@cache
def load_forward_mode() -> None:
    """Loads what forward mode needs: PyTorch calls a function for it that it has deprecated, and warns of that."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with forward_ad.dual_level():
            forward_ad.make_dual(torch.zeros(1), torch.ones(1))  # type: ignore[no-untyped-call]


# whether torch.func.grad, vmap or another transform is at work
transforms_active: Callable[[], bool] = torch._C._are_functorch_transforms_active


def in_plain_mode(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """A function that needs gradients and its own precision, whatever its caller has set.

    Meanwhile inference mode and autocast are off, and the default device is the CPU.  Tensors that were made in
    inference mode, which cannot be part of a graph, are copied.  In a transform it raises ValueError: PyTorch records
    no gradients of its own there, or ends the process.
    """

    def plain(value: object) -> object:
        return value.clone() if isinstance(value, torch.Tensor) and value.is_inference() else value

    @wraps(function)
    def called(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        if transforms_active():
            raise ValueError(
                f"{function.__name__} must be called outside of torch.func.grad, torch.vmap and other transforms: it "
                "has no derivative"
            )
        with ExitStack() as modes:
            modes.enter_context(torch.inference_mode(False))
            for device in ("cpu", "cuda"):
                if torch.is_autocast_enabled(device):
                    modes.enter_context(torch.autocast(device, enabled=False))
            if torch.get_default_device().type != "cpu":
                modes.enter_context(torch.device("cpu"))
            return function(*map(plain, args), **{name: plain(value) for name, value in kwargs.items()})  # type: ignore[arg-type]

    return called
