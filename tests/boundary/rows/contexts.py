"""What a caller may have set: modes of PyTorch, compilers, threads, processes."""

from __future__ import annotations

import decimal
import io
import logging
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..table import Call, NotApplicable, Row, numbers

HERE = Path(__file__).parents[3]
WAIT = 300  # seconds for a process


def inside(context: Callable[[], AbstractContextManager[Any]]) -> Callable[[Call], Any]:
    def run(call: Call) -> Any:
        with context():
            return call.run()

    return run


@contextmanager
def setting(change: Callable[[Any], Any], value: Any, before: Any) -> Iterator[None]:
    """A setting of the whole process."""
    change(value)
    try:
        yield
    finally:
        change(before)


@contextmanager
def elsewhere() -> Iterator[None]:
    """In another folder, which is gone."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def twice(call: Call) -> Any:
    call.run()
    return call.run()


def in_a_thread(call: Call) -> Any:
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(call.run).result()


def in_two_threads(call: Call) -> Any:
    """Two at once; of the first, and the second one has to be the same."""
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(lambda _: numbers(call.run()), range(2))
    if not np.allclose(one, other, rtol=0, atol=call.column.tolerance, equal_nan=True):
        raise AssertionError("two threads get different results")
    return one


def forked(call: Call) -> Any:
    """In a child of this process that has called no more than this one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Python, about threads
        context = multiprocessing.get_context("fork")
        receiver, sender = context.Pipe(duplex=False)

        def work() -> None:
            try:
                sender.send(numbers(call.run()))
            except Exception as error:
                sender.send(RuntimeError(f"{type(error).__name__}: {error}"))

        process = context.Process(target=work)
        process.start()
    sender.close()
    try:
        if not receiver.poll(60):
            process.kill()
            raise TimeoutError("the forked process hangs")
        result = receiver.recv()
    finally:
        process.join()
    if isinstance(result, Exception):
        raise result
    return result


@cache
def of_process(closed: bool) -> dict[str, Any]:
    """All plain results, computed in one new process, perhaps without standard output."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "results.pickle")
        command = [sys.executable, "-m", f"{__package__.rsplit('.', 1)[0]}", "--plain", str(file)]
        if closed:
            command = ["sh", "-c", '"$@" >&-', "sh", *command]
        done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=WAIT, check=False)
        if done.returncode:
            raise AssertionError(f"status {done.returncode}: {done.stderr.strip()[-300:]}")
        results: dict[str, Any] = pickle.loads(file.read_bytes())
        return results


def in_a_process(*, closed: bool) -> Callable[[Call], Any]:
    def run(call: Call) -> Any:
        result = of_process(closed)[call.column.name]
        if isinstance(result, str):
            raise RuntimeError(result)
        return result

    return run


@contextmanager
def without_words() -> Iterator[None]:
    """Without PyTorch's own warnings and listings."""
    logging.disable()
    try:
        with warnings.catch_warnings(), redirect_stderr(io.StringIO()), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)


def compiled(call: Call) -> Any:
    if not call.column.traceable:
        raise NotApplicable
    with without_words():
        torch._dynamo.reset()
        return torch.compile(call.use.call, backend="aot_eager")(call.use.plain(call.use.base))


class Module(torch.nn.Module):
    def __init__(self, call: Callable[[Any], Any]) -> None:
        super().__init__()
        self.call = call

    def forward(self, x: Any) -> Any:
        return self.call(x)


def exported(call: Call) -> Any:
    if not call.column.traceable:
        raise NotApplicable
    x = call.use.plain(call.use.base)
    with without_words():
        return torch.export.export(Module(call.use.call), (x,)).module()(x)


def plain_tensor(call: Call) -> torch.Tensor:
    x = call.use.plain(call.use.base)
    x = torch.from_numpy(x.copy()) if isinstance(x, np.ndarray) else x
    if not isinstance(x, torch.Tensor) or not x.is_floating_point():
        raise NotApplicable
    return x


def mapped(call: Call) -> Any:
    """Under ``torch.func.vmap``, one input a call."""
    return torch.func.vmap(call.use.call)(plain_tensor(call)[None])


def differentiated(call: Call) -> Any:
    """Inside ``torch.func.grad``."""
    results: list[Any] = []

    def read(x: torch.Tensor) -> torch.Tensor:
        results.append(numbers(call.use.call(x)))
        return x.sum()

    torch.func.grad(read)(plain_tensor(call))
    return results[0]


CONTEXTS: dict[str, Callable[[], AbstractContextManager[Any]]] = {
    "no_grad": torch.no_grad,
    "set_grad_enabled(False)": lambda: torch.set_grad_enabled(False),
    "inference_mode": torch.inference_mode,
    "autocast bfloat16": lambda: torch.autocast("cpu", torch.bfloat16),
    "default dtype float64": lambda: setting(torch.set_default_dtype, torch.float64, torch.float32),
    "default dtype float16": lambda: setting(torch.set_default_dtype, torch.float16, torch.float32),
    "default device elsewhere": lambda: torch.device("meta"),
    "deterministic algorithms": lambda: setting(torch.use_deterministic_algorithms, True, False),
    "np.errstate(all='raise')": lambda: np.errstate(all="raise"),
    "decimal context": decimal.localcontext,
    "two threads of PyTorch": lambda: setting(torch.set_num_threads, 2, 1),
    "saved tensors on the CPU": torch.autograd.graph.save_on_cpu,
    "a folder that is gone": elsewhere,
    "no standard output": lambda: redirect_stdout(None),  # as under pythonw and cron
}
RUNS: dict[str, Callable[[Call], Any]] = {
    "twice": twice,
    "in a thread": in_a_thread,
    "in two threads": in_two_threads,
    "in a forked process": forked,
    "in a spawned process": in_a_process(closed=False),
    "standard output closed": in_a_process(closed=True),
    "torch.compile": compiled,
    "torch.export": exported,
}
TRANSFORMS: dict[str, Callable[[Call], Any]] = {"torch.func.vmap": mapped, "torch.func.grad": differentiated}
_READ = {"render": "the numbers of poses are read: it is refused in one sentence"}
LEFT_OUT = {
    "in a forked process": dict.fromkeys(
        ("page", "page /api/pose", "page /api/invert"), "a server has threads, which no fork has"
    ),
    "torch.export": _READ,
    "torch.func.vmap": _READ,
}
ROWS = [
    *[Row(name, "context", inside(context), must="be taken", tolerance=1e-5) for name, context in CONTEXTS.items()],
    *[
        Row(name, "context", run, must=must, tolerance=1e-5, leaves_out=LEFT_OUT.get(name, {}))
        for must, runs in (("be taken", RUNS), ("be taken if traceable", TRANSFORMS))
        for name, run in runs.items()
    ],
]
