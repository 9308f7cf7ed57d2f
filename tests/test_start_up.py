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


FORKS = """
import os, sys, torch
for program in sys.argv[1:]:
    if not os.fork():
        exec(program, {})
        sys.stdout.flush()
        os._exit(0)
    assert os.wait()[1] == 0, program"""


def show(program: str, *arguments: str) -> str:
    """What a fresh process prints."""
    ended = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def show_each(*programs: str) -> list[str]:
    """The lines that programs print, each in a process that has loaded PyTorch, and nothing of the package."""
    return show(FORKS, *programs).splitlines()


def loaded_by(program: str) -> set[str]:
    """Which of HEAVY a fresh process has loaded at the end of the program."""
    shown = show(f"{program}\nimport sys\nprint('loaded', *(name for name in {HEAVY} if name in sys.modules))")
    return set(shown.splitlines()[-1].split()[1:])


@pytest.mark.parametrize(("before", "after"), [(None, "passive"), ("active", "active")])
def test_threads_of_the_command_sleep_while_they_wait(
    before: str | None, after: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    if before:
        monkeypatch.setenv("OMP_WAIT_POLICY", before)
    program = "import os, sys; from nablahog.__main__ import main; sys.argv = ['nablahog', '--version']; main()"
    assert show(f"{program}; print(os.environ['OMP_WAIT_POLICY'])").splitlines()[-1] == after


def test_importing_is_light() -> None:
    assert loaded_by(f"import nablahog.cli.main, {', '.join(LAZY)}") == set()
    assert loaded_by("import nablahog; nablahog.HOGSpec.from_json(nablahog.presets.paper().to_json())") == set()
    assert loaded_by("import numpy") == {"numpy"}  # which would be seen


BLOCKED = "import sys\nfor name in {}: sys.modules[name] = None\n"  # as if they were not installed


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_every_name_is_there() -> None:
    """In fresh processes, where nothing has loaded the modules, each by itself."""
    programs = []
    for name in LAZY:
        package = import_module(name)
        assert dir(package) == package.__all__
        program = f"import sys, {name}\nfor n in {package.__all__}: getattr(sys.modules['{name}'], n)\n"
        programs.append(f"{program}from {name} import *\nassert set({package.__all__}) <= set(globals())")
    assert show_each(*programs) == []


@pytest.mark.parametrize("name", ["metrics", "compat.opencv", "compat.skimage", "compat.sklearn"])
def test_tab_completion_shows_public_names_alone(name: str) -> None:
    shown = {each for each in dir(import_module(f"nablahog.{name}")) if not each.startswith("__")}
    assert shown == {*members(import_module(f"nablahog.{name}"))}


@pytest.mark.slow
def test_a_wrong_name_is_told_the_nearest() -> None:
    """By Python itself, which asks ``dir()``."""
    names = {"presets.uoctty": "uoctti", "HOGspec": "HOGSpec", "metrics.cross_corelation": "cross_correlation"}
    report = "except AttributeError: sys.stderr = sys.stdout; sys.__excepthook__(*sys.exc_info())"
    shown = show_each(*(f"import nablahog, sys\ntry: nablahog.{wrong}\n{report}" for wrong in names))
    told = [line.split("Did you mean: ")[1] for line in shown if line.startswith("AttributeError")]
    assert told == [f"'{right}'?" for right in names.values()]


def test_a_wrong_preset_is_told_the_nearest() -> None:
    with pytest.raises(ValueError, match="did you mean 'uoctti'"):
        HOG("UoCTTI")


@pytest.mark.slow
def test_functions_win_over_packages_of_their_names_and_modules_are_reached_all_the_same() -> None:
    ways = (
        "from nablahog import NAME; import nablahog.NAME",
        "import nablahog.hog.descriptor, nablahog.render.camera, nablahog",
        "import nablahog; nablahog.NAME; import nablahog.NAME",
    )
    programs = [
        f"{way}\nprint(type(nablahog.NAME))".replace("NAME", name) for way in ways for name in ("hog", "render")
    ]
    assert show_each(*programs) == ["<class 'function'>"] * 6
    modules = (
        "import nablahog.hog.kernels as module",
        "import nablahog; nablahog.hog; import nablahog.hog.kernels; module = nablahog.hog.kernels",
        "import nablahog.render.camera as module",
    )
    names = "module.__name__, type(nablahog.hog).__name__, type(nablahog.render).__name__"
    assert show_each(
        *(f"{program}\nimport nablahog\nprint({names})" for program in modules),
        "import nablahog\nprint(nablahog.invert.choices.QualityName.__name__)",
    ) == [f"nablahog.{name} function function" for name in ("hog.kernels", "hog.kernels", "render.camera")] + [
        "Literal"
    ]


def test_names_are_read_from_a_zip_file(tmp_path: Path) -> None:
    source, archive = Path(nablahog.__file__).parent, tmp_path / "package.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in [*source.rglob("*.py"), *source.rglob("*.pyi")]:
            file.write(path, path.relative_to(source.parent))
    program = f"import sys; sys.path.insert(0, {str(archive)!r}); import nablahog\n"
    assert show(f"{program}print(nablahog.presets.uoctti().channels, 'zip' in nablahog.__file__)") == "31 True\n"


def test_the_version_is_that_of_the_installed_package() -> None:
    assert nablahog.__version__ == importlib.metadata.version("nablahog")


@pytest.mark.slow
def test_it_compiles_as_the_first_thing() -> None:
    """torch.compile looks names up in its own way."""
    program = """
import nablahog, torch
spec = nablahog.presets.paper()
images = torch.rand(1, 1, 16, 16)
compiled = torch.compile(lambda x: nablahog.hog(x, spec), fullgraph=True, backend="eager")
print(torch.equal(compiled(images), nablahog.hog(images, spec)))"""
    assert show(program) == "True\n"


@pytest.mark.slow
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
