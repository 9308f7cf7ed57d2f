"""The package's own first use of PyTorch's forward mode, in which PyTorch warns of itself, says nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest

FIRST_USES = {
    "a spec without loops": """
from dataclasses import replace
from nablahog.hog.engines import histograms_jvp
images, spec = torch.rand(1, 1, 16, 16), replace(nablahog.presets.paper(), mask="sobel", border="zero")
use = lambda: histograms_jvp(images, images, spec)
""",
}


@pytest.mark.parametrize("name", FIRST_USES)
def test_it_says_nothing(name: str) -> None:
    program = f"import warnings, torch, nablahog\n{FIRST_USES[name]}\nwarnings.simplefilter('error')\nuse()"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
