"""Which library is loaded, what is said where there is none, and which arrays its functions take."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog import native

HERE = Path(native.__file__).parent
compiled = pytest.mark.skipif(not native.available(), reason="there are no compiled loops")
HOG = """
import torch, warnings
import nablahog
from nablahog import native
image = torch.rand(1, 1, 32, 32, generator=torch.Generator().manual_seed(0))
for preset in (nablahog.presets.paper(), nablahog.presets.uoctti()):
    result, expected = nablahog.hog(image, preset), nablahog.hog(image, preset, backend="torch")
    torch.testing.assert_close(result, expected, rtol=1e-4, atol=1e-5)
print(native.available())
"""


def run(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A program in a fresh process, with the libraries of the package unless others are named."""
    inherited = {name: value for name, value in os.environ.items() if name != native.LIBRARY_FOLDER}
    return subprocess.run([sys.executable, "-c", program], env=inherited | environment, capture_output=True, text=True)


@pytest.mark.slow
@compiled
@pytest.mark.parametrize(("wanted", "size"), [("v2", 16), ("v3", 32), ("v4", 64)])
def test_the_best_instructions_allowed(wanted: str, size: int) -> None:
    """Or the best that the processor has; a checkout has the processor's own alone, unless CMake was told otherwise."""
    core = HERE / "core.so"
    level = min(int(wanted[1]), ctypes.CDLL(str(core)).nablahog_level())
    if level and not core.with_stem(f"core_v{level}").exists():
        pytest.skip(f"the loops for v{level} are not compiled")
    program = "from nablahog import native; print(native.library().nablahog_vector_bytes())"
    ended = run(program, NABLAHOG_INSTRUCTIONS=wanted)
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) == {0: 16, 2: 16, 3: 32, 4: 64}[level] <= size


@pytest.mark.slow
@compiled
def test_loops_for_another_processor_alone(tmp_path: Path) -> None:
    """Of a checkout that was copied: they are not run."""
    shutil.copy(HERE / "core.so", tmp_path)
    if not ctypes.CDLL(str(HERE / "core.so")).nablahog_level():
        pytest.skip("there is one set of instructions")
    (tmp_path / "core_v5.so").touch()
    ended = run(HOG, NABLAHOG_NATIVE=str(tmp_path))
    assert ended.stdout == "False\n", ended.stderr
    assert ended.stderr.count("RuntimeWarning") == 1
    assert "no compiled loops for this processor" in ended.stderr


@pytest.mark.slow
def test_none_are_taken_without_a_warning() -> None:
    ended = run(f"import warnings; warnings.simplefilter('error'){HOG}", NABLAHOG_INSTRUCTIONS="none")
    assert (ended.stdout, ended.stderr) == ("False\n", "")


@pytest.mark.slow
def test_unknown_instructions_are_refused() -> None:
    ended = run("from nablahog import native; native.library()", NABLAHOG_INSTRUCTIONS="v5")
    assert "NABLAHOG_INSTRUCTIONS must be one of none, v2, v3, v4" in ended.stderr


@pytest.mark.slow
def test_no_library_is_one_warning(tmp_path: Path) -> None:
    ended = run(HOG, NABLAHOG_NATIVE=str(tmp_path))
    assert ended.stdout == "False\n", ended.stderr
    assert ended.stderr.count("RuntimeWarning") == 1
    assert "install a C++ compiler" in ended.stderr


@pytest.mark.slow
@compiled
def test_a_source_that_has_changed_is_not_ignored(tmp_path: Path) -> None:
    copy = shutil.copytree(HERE.parent, tmp_path / "nablahog", ignore=shutil.ignore_patterns("__pycache__", "*.npz"))
    header = copy / "native" / "vec.h"
    if not header.exists():
        pytest.skip("the package is installed without its sources")
    program = "from nablahog import native; print(native.available())"
    for file in header.parent.glob("*.h"):  # as `cp -r` does
        file.touch()
    assert run(program, PYTHONPATH=str(tmp_path)).stdout == "True\n"
    header.write_text(f"{header.read_text()}\n")
    ended = run(program, PYTHONPATH=str(tmp_path))
    assert "Error: vec.h changed after the compiled loops were built" in ended.stderr
    assert ended.returncode


@pytest.mark.slow
def test_an_installation_without_a_compiler(tmp_path: Path) -> None:
    """It is one of plain Python, and does the same on plain PyTorch."""
    pytest.importorskip("scikit_build_core")
    root = Path(__file__).parents[2]
    program = f"from scikit_build_core.build import build_wheel; build_wheel({str(tmp_path)!r})"
    built = subprocess.run(
        [sys.executable, "-c", program],
        cwd=root,
        env=os.environ | {"CXX": str(tmp_path / "none")},
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    shutil.unpack_archive(wheel, tmp_path / "installed", "zip")
    ended = run(f"{HOG}print(nablahog.__file__)", PYTHONPATH=str(tmp_path / "installed"))
    assert ended.stdout.splitlines() == ["False", str(tmp_path / "installed" / "nablahog" / "__init__.py")]
    assert ended.stderr.count("RuntimeWarning") == 1


def address(value: object, *dtypes: type[np.generic]) -> int | None:
    result: int | None = native.array(*dtypes).from_param(value).value
    return result


@pytest.mark.parametrize("writeable", [True, False])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint8, np.int64])
def test_arrays_are_passed_by_their_address(dtype: type[np.generic], writeable: bool) -> None:
    values = np.ones((3, 4), dtype)
    values.setflags(write=writeable)
    assert address(values, dtype) == values.ctypes.data
    assert address(values[1:], dtype, np.int8) == values.ctypes.data + 4 * values.itemsize
    address(values[:0], dtype)  # an empty one has an address that is never read


def test_tensors_are_passed_by_their_address() -> None:
    values = torch.ones(3, 4, requires_grad=True)
    assert address(values, np.float32) == values.data_ptr()
    assert address(values[1:], np.float32, np.float64) == values.data_ptr() + 16


@pytest.mark.parametrize(
    "value",
    [
        np.zeros(3),
        np.zeros((3, 4), np.float32).T,
        np.zeros(6, np.float32)[::2],
        torch.zeros(3, dtype=torch.float64),
        torch.zeros(3, 4).T,
        torch.zeros(3, device="meta"),
    ],
    ids=["dtype", "transposed", "strided", "dtype of a tensor", "transposed tensor", "device"],
)
def test_other_arrays_are_refused(value: object) -> None:
    with pytest.raises(TypeError, match="C-contiguous array of float32 on a CPU"):
        address(value, np.float32)


def test_functions_are_looked_up_at_their_first_call(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_long)

    class Library:
        nablahog_enough = kind(lambda number: seen.append(number) or 0)  # type: ignore[func-returns-value]
        nablahog_too_much = kind(lambda number: 1)

    monkeypatch.setattr(native, "library", Library)
    enough = native.function("enough", ctypes.c_long)
    too_much = native.function("too_much", ctypes.c_long)
    enough(3)
    enough(4)
    assert seen == [3, 4]
    with pytest.raises(MemoryError, match="nablahog_too_much"):
        too_much(5)
