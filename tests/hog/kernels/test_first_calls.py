"""First calls in fresh processes with an empty cache of machine code: they compile, and are right."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nablahog.runtime.cache_folder import VARIABLE

PROGRAM = """
import logging, sys
logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
import torch
import nablahog
spec, generator = nablahog.presets.uoctti(), torch.Generator().manual_seed(0)
images = torch.rand(1, 1, 24, 24, generator=generator)
for x in (images, images.requires_grad_(), (255 * images.detach()).to(torch.uint8)):
    some = [nablahog.hog(x, spec, backend=backend) for backend in ("auto", "torch")]
    if x.requires_grad:
        some = [torch.autograd.grad(one.square().sum(), x)[0] for one in some]
    torch.testing.assert_close(*some, rtol=1e-4, atol=1e-5)
print("right")
"""


def start(cache: Path) -> subprocess.Popen[str]:
    """A process that prints its log, and at last that its results are those of the reference steps."""
    environment = os.environ | {VARIABLE: str(cache)}
    return subprocess.Popen([sys.executable, "-u", "-c", PROGRAM], env=environment, stdout=subprocess.PIPE, text=True)


def lines(cache: Path) -> list[str]:
    """What it prints."""
    with start(cache) as process:
        assert process.stdout is not None
        return list(process.stdout)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cache of a process that was killed while it compiled."""
    folder = tmp_path_factory.mktemp("cache")
    with start(folder) as process:
        assert process.stdout is not None
        while not process.stdout.readline().startswith("compiled "):  # the first loop of several
            assert process.poll() is None
        process.kill()
    return folder


def test_after_a_process_that_was_killed_while_it_compiled(cache: Path) -> None:
    first = lines(cache)
    assert [line for line in first if line.startswith("compiling")] == [
        f"compiling loops for this processor, once; some take seconds. They are kept in {cache / 'machine-code'}\n"
    ]
    compiled = [line.split()[1] for line in first if line.startswith("compiled ")]
    assert len(compiled) == len(set(compiled))  # once for uint8 and float32
    assert first[-1] == "right\n"
    assert lines(cache) == ["right\n"]  # from disk
