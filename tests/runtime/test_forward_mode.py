"""The package's own first use of PyTorch's forward mode, in which PyTorch warns of itself, says nothing."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import warnings, torch, nablahog
from dataclasses import replace
from nablahog.hog.descriptor import histograms_jvp
images, spec = torch.rand(1, 1, 16, 16), replace(nablahog.presets.paper(), mask="sobel", border="zero")
warnings.simplefilter("error")
histograms_jvp(images, images, spec)
"""


def test_it_says_nothing() -> None:
    ended = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
