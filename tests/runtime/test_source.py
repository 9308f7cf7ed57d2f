"""Which code decides a result: found by following imports, so that nothing is left out."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from nablahog.paper.methods import METHODS
from nablahog.paper.pose_job import PoseJob
from nablahog.paper.pose_methods import POSE_METHODS
from nablahog.paper.reconstruction import ReconstructionJob
from nablahog.runtime import source
from nablahog.runtime.source import PACKAGE, imported_files

TABLE1 = tuple(source._file(each) for each in (ReconstructionJob, METHODS["uoctti-single"].run))
TABLE2 = tuple(source._file(each) for each in (PoseJob, POSE_METHODS["best"].run))
DECIDING = (
    (TABLE1, "native/*.h"),
    (TABLE1, "runtime/__init__.py"),
    (TABLE1, "hog/kernels/[!_]*.py"),
    (TABLE1, "hog/normalizers/[!_]*.py"),
    (TABLE1, "hog/presets/uoctti.py"),
    (TABLE1, "optimize/lbfgs.py"),
    (TABLE1, "paper/baselines/hoggles.py"),
    (TABLE1, "metrics.py"),
    (TABLE2, "native/*.cpp"),
    (TABLE2, "hog/kernels/[!_]*.py"),
    (TABLE2, "optimize/lbfgs.py"),
    (TABLE2, "render/rendering.py"),
    (TABLE2, "pose/whitening.py"),
    (TABLE2, "paper/chairs.py"),
)
OTHER = ("cli/main.py", "cli/commands/table1.py", "viz/html.py", "paper/table1_page.py", "paper/table2_page.py")


def test_every_deciding_module_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a copy of the package, each edited in turn."""
    copy = shutil.copytree(PACKAGE, tmp_path / "nablahog", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(source, "PACKAGE", copy)

    def key(files: tuple[Path, ...]) -> str:
        return source._key.__wrapped__(tuple(copy / file.relative_to(PACKAGE) for file in files))

    before = {files: key(files) for files in (TABLE1, TABLE2)}
    for files, pattern in (*DECIDING, *((files, name) for files in before for name in OTHER)):
        edited = sorted(copy.glob(pattern))[0]
        text = edited.read_text(encoding="utf-8")
        edited.write_text(f"{text}\n# edited\n", encoding="utf-8")
        assert (key(files) != before[files]) == ((files, pattern) in DECIDING), edited
        edited.write_text(text, encoding="utf-8")
    assert all(key(files) == value for files, value in before.items())


WORK = {
    "table1": """
from nablahog.paper.methods import METHODS, Table1Settings
from nablahog.paper.reconstruction import ReconstructionJob
image = np.random.default_rng(0).random((48, 48), np.float32)
for name in ("uoctti-single", "dalal-multi-scale", "cnn-hog", "triangles", "opencv"):
    ReconstructionJob(METHODS[name], image, Table1Settings(max_evaluations=3)).run()
""",
    "table2": """
from nablahog.paper.models import Model
from nablahog.paper.pose_job import PoseJob
from nablahog.paper.pose_methods import POSE_METHODS, Table2Settings
from nablahog.hog.box import Box
image = np.random.default_rng(0).random((1, 48, 48), np.float32)
PoseJob(POSE_METHODS["best"], image, Box(4, 4, 44, 44), (Model("one", 1),), (30.0, 10.0), Table2Settings()).run()
""",
}


@pytest.mark.parametrize(("name", "files"), [("table1", TABLE1), ("table2", TABLE2)])
def test_what_a_job_loads_decides(name: str, files: tuple[Path, ...]) -> None:
    """In a fresh process: every module of the package that the job's work has loaded in the end."""
    report = "print(*(m.__file__ for n, m in sys.modules.items() if n.split('.')[0] == 'nablahog'), sep='\\n')"
    program = f"import sys\nimport numpy as np\n{WORK[name]}\n{report}"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    loaded = {Path(line) for line in ended.stdout.split()}
    assert len(loaded) > 50
    assert loaded <= imported_files(*files)


def _parsed(file: Path) -> Iterator[str]:
    """The import statements of a file as Python itself parses it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield ast.unparse(node)


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("*.py")), ids=lambda file: file.relative_to(PACKAGE).as_posix())
def test_no_import_is_overlooked(file: Path) -> None:
    result = [ast.unparse(each) for each in source._statements(file.read_text(encoding="utf-8"))]
    assert set(_parsed(file)) <= set(result)


def test_imports_for_types_do_not_count(tmp_path: Path) -> None:
    package = tmp_path / "ours"
    for name, text in {
        "__init__": "if TYPE_CHECKING:\n    from .lazy import late\n    from .never import nothing\n",
        "start": "if TYPE_CHECKING:\n    from .typed import T\n\ndef f():\n"
        "    from . import (\n        late,\n        part,\n    )\n",
        "typed": "",
        "never": "",
        "lazy": "import ours.deep.down\n",
        "late": "",
        "part": "from ourselves import x\nfrom .start import f\n",
        "deep/__init__": "",
        "deep/down": '"""\nimport nothing at all\n"""\nfrom .. import other as o\n',
        "other": "",
    }.items():
        (package / name).parent.mkdir(exist_ok=True, parents=True)
        (package / f"{name}.py").write_text(text)
    files = {
        file.relative_to(package).with_suffix("").as_posix()
        for file in imported_files(package / "start.py", package=package)
    }
    assert files == {"__init__", "start", "lazy", "part", "deep/__init__", "deep/down", "other"}
