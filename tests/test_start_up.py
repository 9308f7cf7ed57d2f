"""What is loaded when: PyTorch takes seconds, so nothing loads it that does not compute."""

from __future__ import annotations

import importlib.metadata
import pydoc
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
import torch

from nablahog import HOG, presets
from nablahog.cli.main import _COMMANDS
from nablahog.runtime.lazy import _Package, names_when_used

HEAVY = ("torch", "numpy", "scipy", "skimage", "PIL", "matplotlib", "rich", "trimesh", "platformdirs")
LAZY = (
    "nablahog",
    "nablahog.paper",
    "nablahog.hog",
    "nablahog.invert",
    "nablahog.io",
    "nablahog.pose",
    "nablahog.viz",
)


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)


def loaded_by(program: str) -> set[str]:
    """Which of HEAVY a fresh process has loaded at the end of the program."""
    ended = run(f"{program}\nimport sys\nprint('loaded', *(name for name in {HEAVY} if name in sys.modules))")
    assert ended.returncode == 0, ended.stderr
    return set(ended.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize(("before", "after"), [(None, "passive"), ("active", "active")])
def test_threads_of_the_command_sleep_while_they_wait(
    before: str | None, after: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    if before:
        monkeypatch.setenv("OMP_WAIT_POLICY", before)
    program = "import os, sys; from nablahog.__main__ import main; sys.argv = ['nablahog', '--version']; main()"
    assert run(f"{program}; print(os.environ['OMP_WAIT_POLICY'])").stdout.splitlines()[-1] == after


def test_heavy_modules_would_be_seen() -> None:
    assert loaded_by("import numpy") == {"numpy"}


@pytest.mark.parametrize(
    "program", ["import nablahog", "import nablahog.cli.main", *(f"import {name}" for name in LAZY)]
)
def test_importing_is_light(program: str) -> None:
    assert loaded_by(program) == set()


def test_specs_are_light() -> None:
    assert loaded_by("import nablahog; nablahog.HOGSpec.from_json(nablahog.presets.paper().to_json())") == set()


@pytest.mark.parametrize(
    "argv", [["--help"], ["--version"], ["learn", "--help"], *([*c.split(), "--help"] for c in _COMMANDS)]
)
def test_help_is_light(argv: list[str]) -> None:
    assert loaded_by(f"from nablahog.cli.main import main; assert main({argv}) == 0") == set()


@pytest.mark.parametrize(
    "argv",
    [
        [],
        ["hog"],
        ["hog", "a.png", "-o", "b.npz", "--device", "tpu"],
        ["invert", "a.png", "-o", "b", "--descriptor", "sift"],
        ["table1", "-o", "b", "--methods", "best"],
    ],
)
def test_wrong_arguments_are_refused_lightly(argv: list[str]) -> None:
    assert loaded_by(f"from nablahog.cli.main import main; assert main({argv}) == 2") == set()


@pytest.mark.parametrize("command", _COMMANDS)
def test_every_command_is_there(command: str) -> None:
    module, function = _COMMANDS[command].split(".")
    assert callable(getattr(import_module(f"nablahog.cli.commands.{module}"), function))


@pytest.mark.parametrize("name", LAZY)
def test_every_name_is_there(name: str) -> None:
    """In a fresh process, where nothing has loaded the modules, each by itself."""
    package = import_module(name)
    assert {n for n in dir(package) if not n.startswith("__")} == {*package.__all__} - {"__version__"}
    assert set(package.__dict__["_homes"]) <= set(package.__all__)
    program = f"import sys, {name}\nfor n in {package.__all__}: getattr(sys.modules['{name}'], n)\n"
    ended = run(f"{program}from {name} import *\nassert set({package.__all__}) <= set(globals())")
    assert ended.returncode == 0, ended.stderr


def show(program: str) -> str:
    ended = run(program)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.mark.parametrize("name", ["hog", "render"])
@pytest.mark.parametrize(
    "program",
    [
        "from nablahog import NAME; import nablahog.NAME",
        "import nablahog.NAME, nablahog",
        "from nablahog.NAME import NAME; import nablahog",
        "import nablahog.hog.descriptor, nablahog.render.camera, nablahog",
        "import nablahog; nablahog.NAME; import nablahog.NAME",
    ],
)
def test_the_function_wins_over_the_package_of_its_name(program: str, name: str) -> None:
    program = f"{program}\nprint(type(nablahog.NAME))".replace("NAME", name)
    assert show(program) == "<class 'function'>\n"


@pytest.mark.parametrize(
    ("program", "name"),
    [
        ("import nablahog.hog.kernels as module", "hog.kernels"),
        ("import nablahog.hog.kernels; module = nablahog.hog.kernels", "hog.kernels"),
        ("import nablahog; nablahog.hog; import nablahog.hog.kernels; module = nablahog.hog.kernels", "hog.kernels"),
        ("from nablahog import hog; import nablahog.hog.kernels as module", "hog.kernels"),
        ("from nablahog.hog import kernels as module", "hog.kernels"),
        ("import nablahog.hog.presets as module", "hog.presets"),
        ("import nablahog.hog.operators as module", "hog.operators"),
        ("import nablahog.render.camera as module", "render.camera"),
    ],
)
def test_its_modules_are_reached_all_the_same(program: str, name: str) -> None:
    shown = show(f"{program}\nimport nablahog\nprint(type(nablahog.hog), type(nablahog.render), module.__name__)")
    assert shown == f"<class 'function'> <class 'function'> nablahog.{name}\n"


def test_so_it_does_in_other_packages() -> None:
    program = "import nablahog.pose.elements\nprint(nablahog.pose.elements.__name__, type(nablahog.pose.elements))"
    assert show(program) == "elements <class 'function'>\n"


def test_modules_can_be_reached_without_being_imported() -> None:
    assert show("import nablahog\nprint(nablahog.invert.options.QualityName.__name__)") == "Literal\n"


def test_help_shows_the_public_face() -> None:
    import nablahog

    shown = pydoc.render_doc(nablahog, renderer=pydoc.plaintext)
    assert f"VERSION\n    {nablahog.__version__}\n" in shown
    for name in {*nablahog.__all__} - {"__version__"}:
        assert re.search(rf"\b{name}\b", shown), name
    assert "reconstruct(" in shown
    assert "class Reconstruction(" in shown


def test_the_version_is_that_of_the_installed_package() -> None:
    import nablahog

    assert nablahog.__version__ == importlib.metadata.version("nablahog")


def test_it_compiles_as_the_first_thing() -> None:
    """torch.compile looks names up in its own way."""
    program = """
import nablahog, torch
spec = nablahog.presets.paper()
images = torch.rand(1, 1, 16, 16)
compiled = torch.compile(lambda x: nablahog.hog(x, spec), fullgraph=True, backend="eager")
print(torch.equal(compiled(images), nablahog.hog(images, spec)))"""
    assert show(program) == "True\n"


def test_exported_graphs_need_the_operator(tmp_path: Path) -> None:
    path, images = tmp_path / "hog.pt2", torch.rand(1, 1, 16, 16)
    torch.export.save(torch.export.export(HOG(presets.paper()), (images,)), path)
    program = (
        f"import nablahog.hog.operators, torch; print(torch.export.load({str(path)!r}).graph_signature.user_inputs)"
    )
    assert show(program) == "('images',)\n"


@pytest.mark.parametrize("name", ["nothing", "_private", "__wrapped__", "presets.nothing"])
def test_other_names_are_not_there(name: str) -> None:
    import nablahog

    owner, _, last = name.rpartition(".")
    with pytest.raises(AttributeError, match=rf"has no attribute '{last}'"):
        getattr(nablahog.presets if owner else nablahog, last)


def test_a_name_is_looked_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    package = ModuleType("json")  # whose module `decoder` is loaded
    monkeypatch.setitem(sys.modules, "json", package)
    names_when_used("json", decoder=["JSONDecoder"])
    assert isinstance(package, _Package)
    assert "JSONDecoder" in dir(package)
    assert "JSONDecoder" not in package.__dict__
    result = package.JSONDecoder
    assert package.__dict__["JSONDecoder"] is result
    package.JSONDecoder = 3  # what tests do
    assert package.JSONDecoder == 3
    package.JSONDecoder = ModuleType("json.JSONDecoder")  # what Python does
    assert package.JSONDecoder == 3
