"""What is loaded when: PyTorch takes seconds, so nothing loads it that does not compute."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import zipfile
from importlib import import_module
from pathlib import Path

import pytest
import torch

import nablahog
from nablahog import HOG
from nablahog.cli.main import _COMMANDS
from tests.public_surface import members

HEAVY = ("torch", "numpy", "scipy", "skimage", "PIL", "matplotlib", "rich", "trimesh", "platformdirs")
STUBS = sorted(Path(nablahog.__file__).parent.rglob("__init__.pyi"))
LAZY = [".".join(stub.parent.relative_to(Path(nablahog.__file__).parents[1]).parts) for stub in STUBS]


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


def test_importing_is_light() -> None:
    assert loaded_by(f"import nablahog.cli.main, {', '.join(LAZY)}") == set()
    assert loaded_by("import nablahog; nablahog.HOGSpec.from_json(nablahog.presets.paper().to_json())") == set()
    assert loaded_by("import numpy") == {"numpy"}  # which would be seen


BLOCKED = "import sys\nfor name in {}: sys.modules[name] = None\n"  # as if they were not installed


def test_hog_needs_pytorch_and_numpy_alone() -> None:
    others = [name for name in HEAVY if name not in ("torch", "numpy")]
    program = f"""{BLOCKED.format(others)}
import numpy, torch, nablahog
from nablahog.compat import opencv, skimage
image = torch.rand(1, 3, 64, 64, requires_grad=True)
for name in ("paper", "uoctti", "opencv"):
    nablahog.HOG(name)(image).square().sum().backward()
print(skimage.hog(numpy.ones((32, 32))).shape, nablahog.hog(numpy.ones((32, 32)), "paper").shape)"""
    assert show(program) == "(324,) (4, 4, 9)\n"


def test_poses_and_pre_images_need_no_photographs() -> None:
    program = f"""{BLOCKED.format(["skimage"])}
import nablahog
from nablahog.render import pose
chair, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, height=96, width=96)
photo = nablahog.render(chair, pose(azimuth=30, elevation=20, distance=3), camera)[0]
nablahog.estimate_pose(photo, chair)
image = nablahog.reconstruct(nablahog.hog(photo[None], "uoctti"), "uoctti", quality="fast").image
print(0 < nablahog.metrics.ssim(image[0, 0], photo[0]) < 1)"""
    assert show(program) == "True\n"


def test_help_and_refusals_are_light() -> None:
    asked = [["--help"], ["--version"], ["learn", "--help"], *([*command.split(), "--help"] for command in _COMMANDS)]
    wrong = [[], ["hog"], ["invert", "a.png", "-o", "b", "--device", "tpu"], ["table1", "-o", "b", "--methods", "best"]]
    program = f"""
from nablahog.cli.main import main
for argv in {asked}: assert main(argv) == 0, argv
for argv in {wrong}: assert main(argv) == 2, argv"""
    assert loaded_by(program) == set()


@pytest.mark.parametrize("name", LAZY)
def test_every_name_is_there(name: str) -> None:
    """In a fresh process, where nothing has loaded the modules, each by itself."""
    package = import_module(name)
    assert dir(package) == package.__all__
    program = f"import sys, {name}\nfor n in {package.__all__}: getattr(sys.modules['{name}'], n)\n"
    ended = run(f"{program}from {name} import *\nassert set({package.__all__}) <= set(globals())")
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize("name", ["metrics", "compat.opencv", "compat.skimage", "compat.sklearn"])
def test_tab_completion_shows_public_names_alone(name: str) -> None:
    shown = {each for each in dir(import_module(f"nablahog.{name}")) if not each.startswith("__")}
    assert shown == {*members(import_module(f"nablahog.{name}"))}


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("presets.uoctty", "uoctti"), ("HOGspec", "HOGSpec"), ("metrics.cross_corelation", "cross_correlation")],
)
def test_a_wrong_name_is_told_the_nearest(wrong: str, right: str) -> None:
    """By Python itself, which asks ``dir()``."""
    ended = run(f"import nablahog\nnablahog.{wrong}")
    assert f"Did you mean: '{right}'?" in ended.stderr.splitlines()[-1]


def test_a_wrong_preset_is_told_the_nearest() -> None:
    with pytest.raises(ValueError, match="did you mean 'uoctti'"):
        HOG("UoCTTI")


def show(program: str) -> str:
    ended = run(program)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.mark.parametrize("name", ["hog", "render"])
@pytest.mark.parametrize(
    "program",
    [
        "from nablahog import NAME; import nablahog.NAME",
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
        ("import nablahog; nablahog.hog; import nablahog.hog.kernels; module = nablahog.hog.kernels", "hog.kernels"),
        ("import nablahog.render.camera as module", "render.camera"),
    ],
)
def test_its_modules_are_reached_all_the_same(program: str, name: str) -> None:
    shown = show(f"{program}\nimport nablahog\nprint(type(nablahog.hog), type(nablahog.render), module.__name__)")
    assert shown == f"<class 'function'> <class 'function'> nablahog.{name}\n"


def test_modules_can_be_reached_without_being_imported() -> None:
    assert show("import nablahog\nprint(nablahog.invert.choices.QualityName.__name__)") == "Literal\n"


def test_names_are_read_from_a_zip_file(tmp_path: Path) -> None:
    source, archive = Path(nablahog.__file__).parent, tmp_path / "package.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in [*source.rglob("*.py"), *source.rglob("*.pyi")]:
            file.write(path, path.relative_to(source.parent))
    program = f"import sys; sys.path.insert(0, {str(archive)!r}); import nablahog\n"
    assert show(f"{program}print(nablahog.presets.uoctti().channels, 'zip' in nablahog.__file__)") == "31 True\n"


def test_the_version_is_that_of_the_installed_package() -> None:
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
    torch.export.save(torch.export.export(HOG("paper"), (images,)), path)
    program = (
        f"import nablahog.hog.operators, torch; print(torch.export.load({str(path)!r}).graph_signature.user_inputs)"
    )
    assert show(program) == "('images',)\n"


def test_other_names_are_not_there() -> None:
    for name in ("nothing", "_private", "__wrapped__", "metrics.images"):
        with pytest.raises(AttributeError, match=f"attribute '{name}'"):
            getattr(nablahog, name)
    with pytest.raises(AttributeError, match="did you mean 'reconstruct'"):
        _ = nablahog.recontruct
