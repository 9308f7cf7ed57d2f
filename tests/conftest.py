"""What every test shares."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator

import pytest
import torch
from hypothesis import settings

from nablahog import native, presets
from nablahog.paper.baselines.bovw_learning import learn_bovw
from nablahog.paper.baselines.hoggles_learning import learn_hoggles
from nablahog.runtime.pytorch import load_forward_mode

# derandomized: a failure belongs to a change, never to the luck of the run
settings.register_profile("nablahog", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("nablahog")

# On a machine that is busy with something else, threads that wait for each other make minutes of seconds.
torch.set_num_threads(1)

# Where there is no GPU, Triton's interpreter runs its kernels on the CPU.  Triton asks when it is loaded.
if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")

os.environ["NABLAHOG_CACHE_SIZE"] = "0"  # what an earlier run has stored must not hide a mistake

with warnings.catch_warnings():
    warnings.simplefilter("default")
    native.available()  # warns once, and here, where it fails no test, if all tests run on plain PyTorch
load_forward_mode()  # tests use it themselves, and turn warnings into errors


@pytest.fixture(autouse=True)
def _same_numbers_every_time() -> None:
    """A failure belongs to a change here, too."""
    torch.manual_seed(0)


@pytest.fixture
def two_threads() -> Iterator[None]:
    """Of PyTorch, while the test runs."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def learned_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Files of what the baselines of the table have learned, next to nothing; words are for images of 40x40 pixels."""
    from skimage import data

    camera = torch.from_numpy(data.camera() / 255).float()[::4, ::4]
    images, spec = {"a": camera[:96, :96].contiguous()}, presets.uoctti()
    folder = tmp_path_factory.mktemp("learned")
    files = {kind: str(folder / f"{kind}.npz") for kind in ("hoggles", "bovw")}
    learn_hoggles(images, spec, atoms=8, fast=True).save(files["hoggles"])
    squares = {str(k): camera[:40, 20 * k : 20 * k + 40].contiguous() for k in range(4)}
    learn_bovw(squares, words=3, patch=32).save(files["bovw"])
    return files
