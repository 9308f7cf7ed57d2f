"""The scripts of the gallery and the tutorials run without a warning, and each shows pictures with something on them.

Building the pages, which `.ci/run` does, runs them, too, and looks at their pictures.
"""

from __future__ import annotations

import ast
import runpy
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch

DOCS = Path(__file__).parent.parent / "docs"
SCRIPTS = {path.stem: path for folder in ("gallery", "tutorials") for path in sorted((DOCS / folder).glob("*.py"))}


@pytest.fixture
def pyplot(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Matplotlib without a screen; what scripts change for their process is undone."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    monkeypatch.setattr(pyplot, "show", lambda: None)
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        yield pyplot
    torch.set_num_threads(threads)
    pyplot.close("all")


@pytest.mark.slow
@pytest.mark.xslow
@pytest.mark.parametrize("name", SCRIPTS)
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of tensors, which Matplotlib reads
def test_it_shows_something(name: str, pyplot: ModuleType) -> None:
    if "svm" in name:
        pytest.importorskip("sklearn")
    if "false_positive" in name:
        pytest.importorskip("cv2")  # has the detector
    runpy.run_path(str(SCRIPTS[name]), run_name="__main__")
    numbers = pyplot.get_fignums()
    assert numbers
    for number in numbers:
        figure = pyplot.figure(number)
        figure.canvas.draw()
        assert np.ptp(np.asarray(figure.canvas.buffer_rgba())[..., :3]) > 100
        assert figure.axes


@pytest.mark.parametrize("name", SCRIPTS)
def test_it_uses_no_private_name(name: str) -> None:
    tree = ast.parse(SCRIPTS[name].read_text(encoding="utf-8"))
    imported = [
        part
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("nablahog")
        for part in [*(node.module or "").split("."), *(alias.name for alias in node.names)]
    ]
    assert not [part for part in imported if part.startswith("_")]
