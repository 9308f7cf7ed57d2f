"""Runs of tests in a copy of the checkout: by processes that start with PyTorch loaded, but nothing of the package."""

from __future__ import annotations

import compileall
import contextlib
import importlib
import os
import py_compile
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.mutants.mutant import Checkout, Mutant

PRELOADED = (
    *("torch", "numpy", "scipy.optimize", "scipy.ndimage", "skimage", "cv2", "PIL.Image", "pandas", "pyarrow.parquet"),
    *("hypothesis.strategies", "hypothesis.internal.conjecture.engine", "fsspec", "fastapi.testclient"),
    *("rich.progress", "_hypothesis_pytestplugin", "anyio.pytest_plugin", "xdist.plugin", "pytest_cov.plugin"),
)
NATIVE = Path("native")  # the folder of the package with C++


class Outcome(NamedTuple):
    """What a test gave: "passed", "failed", or "started" where its process crashed or was stopped."""

    test: str
    result: str
    seconds: float


class Progress:
    """A plugin of pytest that runs tests in the order given, and writes what each gives into a file."""

    def __init__(self, tests: Sequence[str], path: Path) -> None:
        self.order = {test: k for k, test in enumerate(tests)}
        self.file = path.open("w", buffering=1)
        self.seconds, self.result = 0.0, "passed"

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: self.order.get(item.nodeid, len(self.order)))

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            print(report.nodeid, "failed", 0.0, sep="\t", file=self.file)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.seconds, self.result = 0.0, "passed"
        print(nodeid, "started", 0.0, sep="\t", file=self.file)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds += report.duration
        if report.failed:
            self.result = "failed"
        if report.when == "teardown":
            print(report.nodeid, self.result, self.seconds, sep="\t", file=self.file)


def preload(modules: Sequence[str]) -> None:
    """Loads what most tests need, once for all runs; the package itself is loaded anew by each."""
    for name in modules:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


def run_tests(tree: Path, tests: Sequence[str], limit: float, *arguments: str) -> list[Outcome]:
    """Runs tests in a process of their own, in a copy of the checkout, for so many seconds at most."""
    path = tree / "progress.txt"
    path.unlink(missing_ok=True)
    process = os.fork()
    if not process:
        os._exit(_run_in_child(tree, tests, path, arguments))
    end = time.monotonic() + limit
    finished = status = 0
    try:
        while not finished and time.monotonic() < end:
            time.sleep(0.02)
            finished, status = os.waitpid(process, os.WNOHANG)
    finally:
        if not finished:
            os.killpg(process, signal.SIGKILL)
            _, status = os.waitpid(process, 0)
    return _read_progress(path, os.waitstatus_to_exitcode(status))


def _run_in_child(tree: Path, tests: Sequence[str], path: Path, arguments: Sequence[str]) -> int:
    os.setsid()  # so that what the tests start is stopped along with them
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.chdir(tree)
    output = os.open(tree / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    for name in [name for name in sys.modules if name.partition(".")[0] == "tests"]:
        del sys.modules[name]  # the copy has its own
    sys.path[:] = [str(tree / "src"), str(tree), *(folder for folder in sys.path if folder)]
    os.environ["PYTHONPATH"] = f"{tree / 'src'}{os.pathsep}{tree}"
    try:
        fixed = ("-q", "-p", "no:cacheprovider", "-p", "no:randomly", "--continue-on-collection-errors")
        chosen = ("-m", "not xslow")
        loaded_before = ("-W", "ignore::pytest.PytestAssertRewriteWarning")  # the plugins, so their asserts are plain
        return int(pytest.main([*fixed, *chosen, *loaded_before, *arguments, *tests], plugins=[Progress(tests, path)]))
    except BaseException:
        traceback.print_exc()
        return 3


def _read_progress(path: Path, status: int) -> list[Outcome]:
    lines = path.read_text().splitlines() if path.exists() else []
    last: dict[str, Outcome] = {}
    for line in lines:
        if line.count("\t") == 2:  # not cut off
            test, result, seconds = line.split("\t")
            last[test] = Outcome(test, result, float(seconds))
    if status not in (0, 1, 5) and not any(outcome.result != "passed" for outcome in last.values()):
        last["exit status"] = Outcome(f"exit status {status}", "failed", 0.0)
    return list(last.values())


def run_all_tests(tree: Path, tests: Sequence[str], limit: float) -> list[Outcome]:
    """Runs tests and goes on after one that crashes or never ends."""
    outcomes: list[Outcome] = []
    rest = list(tests)
    for _ in range(5):  # a mutant that crashes more often has been noticed enough
        news = run_tests(tree, rest, limit)
        outcomes += news
        stopped = [outcome.test for outcome in news if outcome.result == "started"]
        if not stopped:
            break
        finished = {outcome.test for outcome in outcomes}
        rest = [test for test in rest if test not in finished]
        if not rest:
            break
    return outcomes


class Tree:
    """A copy of the checkout, in which lines are broken one after the other."""

    def __init__(self, checkout: Checkout, folder: Path) -> None:
        self.path = folder / "checkout"
        shutil.copytree(
            checkout.root, self.path, ignore=shutil.ignore_patterns(".*", "out", "build", "dist", "__pycache__")
        )
        # of so many changes, two may be of one size and one second: what is compiled is told by the text
        compileall.compile_dir(self.path, quiet=1, invalidation_mode=py_compile.PycInvalidationMode.CHECKED_HASH)
        self.checkout = Checkout(self.path, checkout.package)
        self.libraries = folder / "libraries"

    @contextlib.contextmanager
    def broken(self, mutant: Mutant) -> Iterator[bool]:
        """Has a mutant in the copy meanwhile; False for C++ that does not compile, or to the same code."""
        path = self.checkout.path(mutant.file)
        source, native = path.read_bytes(), mutant.file.suffix != ".py"
        if native and not self.libraries.exists():
            self._store_libraries()
        try:
            path.write_bytes(source[: mutant.start] + mutant.new.encode() + source[mutant.end :])
            yield not native or (self._run_cmake("--build", self._build) and self._has_other_code())
        finally:
            path.write_bytes(source)
            if native:
                for library in self.libraries.iterdir():  # written again, as they have to be newer than the sources
                    shutil.copyfile(library, self.checkout.path(NATIVE) / library.name)

    @property
    def _build(self) -> str:
        return str(self.path / "build" / "native")

    def _store_libraries(self) -> None:
        """Compiles the loops of the copy, for this processor alone, and stores them beside it."""
        compiler_cache = ["-DCMAKE_CXX_COMPILER_LAUNCHER=ccache"] if shutil.which("ccache") else []
        configured = self._run_cmake("-S", str(self.path), "-B", self._build, "-G", "Ninja", *compiler_cache)
        if not configured or not self._run_cmake("--build", self._build):
            raise RuntimeError("the C++ of the checkout does not compile")
        self.libraries.mkdir()
        for library in self.checkout.path(NATIVE).glob("*.so"):
            shutil.copyfile(library, self.libraries / library.name)

    def _has_other_code(self) -> bool:
        folder = self.checkout.path(NATIVE)
        return any((folder / library.name).read_bytes() != library.read_bytes() for library in self.libraries.iterdir())

    def _run_cmake(self, *arguments: str) -> bool:
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, "CCACHE_BASEDIR": str(self.path), "CCACHE_NOHASHDIR": "1"}
        return not subprocess.run(["cmake", *arguments], capture_output=True, env=environment).returncode
