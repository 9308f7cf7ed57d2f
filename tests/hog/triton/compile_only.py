"""A plugin of pytest: kernels are compiled ahead for a GPU that is not there, and not run.

    TRITON_INTERPRET=0 SM=80 python -m pytest -q -p tests.hog.triton.compile_only tests/hog/triton/test_steps.py

The interpreter accepts more than the compiler does.  A test fails if a kernel that it launches cannot be compiled;
results are not checked: they are whatever the memory holds.  Takes half an hour the first time.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from typing import Any

import pytest
import torch
import triton
from triton.backends.compiler import GPUTarget
from triton.runtime.jit import JITFunction

from nablahog.hog import triton as kernels

TARGET = GPUTarget("cuda", int(os.environ.get("SM", "80")), 32)
compiled: set[str] = set()
_run = JITFunction.run


class NoDevice:
    """In the place of Triton's driver: says what to compile for."""

    def get_current_target(self) -> GPUTarget:
        return TARGET

    def get_current_device(self) -> int:
        return int(TARGET.arch)

    def get_current_stream(self, device: int) -> int:
        return 0


def _compile(self: Any, *arguments: Any, grid: Any, warmup: bool, **options: Any) -> None:
    compiled.add(_run(self, *arguments, grid=grid, warmup=True, **options).hash)


triton.runtime.driver.set_active(NoDevice())
JITFunction.run = _compile
setattr(kernels, "interpreted", lambda: True)  # noqa: B010  (images are on a CPU)
setattr(torch, "equal", lambda *_: True)  # noqa: B010  (tests go on to their next launch)
setattr(torch.testing, "assert_close", lambda *_, **__: None)  # noqa: B010


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    try:
        return (yield)
    except AssertionError:
        return None


def pytest_terminal_summary(terminalreporter: Any) -> None:
    terminalreporter.write_line(f"{len(compiled)} kernels compiled for sm_{TARGET.arch}")
