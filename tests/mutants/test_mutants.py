"""The tool on a package of a few lines: what it changes, what it runs, what it keeps, and what it says."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mutants.__main__ import read_options
from tests.mutants.mutant import CHANGES, Checkout, draw_mutants
from tests.mutants.results import Result, judge_tests

FEW_PLUGINS = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": "pytest_cov.plugin"}  # the others take time
COMPILER = shutil.which("c++")
needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes do not start as copies here")
TOY = {
    "src/toy/__init__.py": "",
    "src/toy/box.py": """
def area(width, height):
    if width < 1:
        raise ValueError("width")
    return width * height


def cube(side):
    side = abs(side)
    return power(side, 3)


def power(base, exponent):
    return base**exponent
""",
    "src/toy/native/__init__.py": """
import ctypes
from pathlib import Path


def function(name):
    return getattr(ctypes.CDLL(str(Path(__file__).parent / "core.so")), f"toy_{name}")
""",
    "src/toy/total.py": """
from toy import native

_difference = native.function("difference")


def difference(a, b):
    return _difference(a, b)
""",
    "src/toy/native/core.cpp": """
extern "C" int toy_difference(int a, int b) {
  return a - b;
}
""",
    "CMakeLists.txt": """
cmake_minimum_required(VERSION 3.20)
project(toy LANGUAGES CXX)
set(CMAKE_LIBRARY_OUTPUT_DIRECTORY ${CMAKE_SOURCE_DIR}/src/toy/native)
add_library(core MODULE src/toy/native/core.cpp)
set_target_properties(core PROPERTIES PREFIX "" SUFFIX ".so")
""",
    "tests/__init__.py": "",
    "tests/test_box.py": """
import pytest
from toy.box import area, cube


def test_area():
    assert area(2, 3) == 6


def test_area_again():
    assert area(1, 1) == 1
    assert area(2, 3) == 6


def test_width():
    with pytest.raises(ValueError):
        area(0, 3)


def test_cube():
    assert cube(-2) == 8
""",
    "tests/test_total.py": """
from toy.total import difference


def test_difference():
    assert difference(5, 3) == 2
""",
}


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Checkout:
    root = tmp_path_factory.mktemp("toy")
    for name, text in TOY.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    if COMPILER is None:
        (root / "tests/test_total.py").unlink()
    else:
        native = root / "src/toy/native"
        subprocess.run([COMPILER, "-shared", "-fPIC", native / "core.cpp", "-o", native / "core.so"], check=True)
    return Checkout(root, Path("src", "toy"))


def run(toy: Checkout, *arguments: str) -> list[str]:
    """Runs the tool, and returns the lines that it prints."""
    program = (
        "import sys; from pathlib import Path; from tests.mutants import __main__ as tool; "
        "tool.main(sys.argv[2:], tool.Checkout(Path(sys.argv[1]), Path('src', 'toy')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(toy.root), *arguments],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, env={**os.environ, **FEW_PLUGINS},
    )  # fmt: skip
    assert not done.returncode, done.stderr
    return done.stdout.splitlines()


def replaced(source: str, kind: str) -> Iterator[tuple[int, str]]:
    """Yields the line of each change and its text with the change made."""
    encoded = source.encode()
    for line, start, end, new in CHANGES[kind](encoded):
        yield line, (encoded[:start] + new.encode() + encoded[end:]).decode().splitlines()[line - 1].strip()


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ("if a < b: pass", {"if (a <= b): pass"}),
        ("return -x", {"return --x", "return (x)"}),
        ("f(a, b)", {"(f(b, a))", "pass"}),
        ("max(a, b) + 0.5", {"(max(a, b) - 0.5)", "max(a, b) + (0.625)"}),
        ("x = g(x)", {"pass"}),
        ("x: Literal[1] = 'µ', 2", {"x: Literal[1] = 'µ', (3)"}),
        ("raise ValueError(f'{a + 1}')", {"pass"}),
        ("zip(a, b, strict=True)", {"pass"}),
    ],
)
def test_changes_of_python(source: str, wanted: set[str]) -> None:
    assert {text for _, text in replaced(source, ".py")} == wanted


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ("#include <a.h>\n  if (a < b) {  // 1 < 2", {(2, "if (a <= b) {  // 1 < 2")}),
        ("  x += -y;", {(1, "x -= -y;"), (1, "x += y;"), (1, ";")}),
        ("  const auto z = f(a, b[1]);",
         {(1, "const auto z = f(b[1], a);"), (1, "const auto z = f(a, b[2]);")}),
        ("template <class T, int N = 3>\nT half(T x) { return x * T(0.5f); }",
         {(2, "T half(T x) { return x / T(0.5f); }"), (2, "T half(T x) { return x * T(0.625f); }")}),
        ("  lines.clear();\n  bool µ = true;", {(1, ";"), (2, "bool µ = false;")}),
    ],
)  # fmt: skip
def test_changes_of_cpp(source: str, wanted: set[tuple[int, str]]) -> None:
    assert set(replaced(source, ".cpp")) == wanted


def test_order_of_lines_depends_on_their_texts_alone(toy: Checkout) -> None:
    before = [(mutant.text, mutant.change) for mutant in draw_mutants(toy, ["box.py"], 100, 68)]
    path = toy.path(Path("box.py"))
    source = path.read_text()
    path.write_text('"""Two lines more."""\nLARGEST = 9\n' + source)
    after = [(mutant.text, mutant.change) for mutant in draw_mutants(toy, ["box.py"], 100, 68)]
    path.write_text(source)
    assert len(before) == 6
    assert [pair for pair in after if pair[0] != "LARGEST = 9"] == before


@pytest.mark.slow
@needs_fork
def test_tries_parts_and_resumes(toy: Checkout) -> None:
    run(toy, "--all", "--part", "1/2", "--under", "box.py")
    first = len((toy.root / "out/mutants/results.jsonl").read_text().splitlines())
    assert 0 < first < 6
    run(toy, "--all", "--under", "box.py")
    results = [json.loads(line) for line in (toy.root / "out/mutants/results.jsonl").read_text().splitlines()]
    assert len(results) == len({result["mutant"] for result in results}) == 6
    report = run(toy, "--report", "--under", "box.py")
    assert any(line.startswith("nothing\t") or line.startswith("repeats\t") for line in report)
    assert any(line.startswith("alone\t") and line.endswith("::test_cube") for line in report)


@pytest.mark.slow
@needs_fork
@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")
def test_compiles_what_it_breaks(toy: Checkout) -> None:
    assert "noticed  native/core.cpp:3: - -> +" in run(toy, "--under", "native/core.cpp")


@pytest.mark.parametrize("option", ["--under", "--tests"])
def test_folders_that_are_not_there_are_refused(option: str, toy: Checkout, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        read_options([option, "bax.py"], toy)
    assert "there is no bax.py" in capsys.readouterr().err


def test_judges_tests() -> None:
    results = [
        Result("a.py:1: x", ["a.py"], ["t.py::one[1]", "t.py::one[2]"], complete=True),
        Result("a.py:2: x", ["a.py"], ["t.py::one", "t.py::two"], complete=True),
        Result("a.py:3: x", ["a.py"], ["t.py::three", "t.py::two"], complete=True),
        Result("a.py:4: x", ["a.py"], [], complete=True),
        Result("a.py:5: x", ["a.py"], ["t.py"], complete=True),
    ]
    recorded = ["t.py::one[1]", "t.py::two", "t.py::three", "t.py::four"]
    assert list(judge_tests(results, recorded)) == [
        "alone\t1\t2\tt.py::one",
        "needed\t0\t1\tt.py::three",
        "nothing\t0\t0\tt.py::four",
        "repeats\t0\t2\tt.py::two",
    ]
