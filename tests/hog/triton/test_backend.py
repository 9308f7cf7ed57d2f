"""Which implementation computes, and what is said where Triton is missing."""

from __future__ import annotations

import importlib
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from nablahog import hog, presets
from nablahog.hog import triton as kernels
from nablahog.hog.engine import REFERENCE, Engine
from nablahog.hog.kernels.tables import VOTE_CODES
from nablahog.hog.orientation import HARD_VOTES, LINEAR_VOTES
from nablahog.hog.triton import steps

from ..zoo import noise

CUDA = torch.device("cuda")


@pytest.fixture
def forgetful() -> Any:
    """Nothing is known of the machine."""
    cached = kernels._any_gpu, kernels._missing, kernels._say_once
    for each in cached:
        each.cache_clear()
    yield
    for each in cached:
        each.cache_clear()


def chosen_engine() -> Engine:
    """For images on a GPU."""
    images: Any = SimpleNamespace(device=CUDA, is_cpu=False)
    engine: Engine = importlib.import_module("nablahog.hog.descriptor")._choose_engine(images, presets.paper(), "auto")
    return engine


def test_every_vote_rule_has_a_function() -> None:
    rules = [*LINEAR_VOTES.values(), *HARD_VOTES.values()]
    assert {rule.name for rule in rules} == {*steps.RULES} == {*VOTE_CODES}


def test_auto_takes_triton_on_a_gpu(forgetful: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda _: (7, 0))
    assert chosen_engine() is steps.TRITON_ENGINE
    assert not kernels.chosen(torch.device("cpu"))


@pytest.mark.parametrize(
    "reason", ["Triton is not installed: pip install", "no code for GPUs of compute capability 6.1"]
)
def test_without_it_the_plain_steps_compute_and_say_so_once(
    forgetful: None, monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder, reason: str
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda _: (6, 1))
    if "installed" in reason:
        monkeypatch.setattr(kernels, "find_spec", lambda _: None)
    for _ in range(2):
        assert chosen_engine() is REFERENCE
    (said,) = [str(each.message) for each in recwarn]
    assert reason in said
    with pytest.raises(ModuleNotFoundError, match=reason):
        kernels.check(CUDA)


def test_triton_on_a_cpu_is_an_error_but_for_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_INTERPRET", "0")
    with pytest.raises(ValueError, match="the backend 'triton' computes on a GPU, got images on the device 'cpu'"):
        hog(noise(1, 1, 16, 16), presets.paper(), backend="triton")


@pytest.mark.slow
def test_nothing_of_triton_is_loaded_on_a_cpu() -> None:
    program = """
import sys, torch, nablahog
nablahog.hog(torch.rand(1, 1, 16, 16), nablahog.presets.paper()).sum()
import nablahog.hog.operators
print([name for name in sys.modules if name.startswith("nablahog.hog.triton.")])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
