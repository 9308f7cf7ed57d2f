"""Functions compiled by numba, with their machine code cached on disk."""

from __future__ import annotations

import dis
import hashlib
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any

# No fused multiply-add unless a loop asks for it: which LLVM would fuse depends on what it has inlined.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_PACKAGE = __name__.partition(".")[0]


def _modules_behind(function: FunctionType) -> set[str]:
    """The modules of this package that a function's module takes names from, and those that they take names from."""
    found: set[str] = set()
    names = {function.__module__}
    while names:
        found |= names
        every = (vars(sys.modules[name]).values() for name in names)
        used = {getattr(value, "__module__", None) for values in every for value in values}
        names = {name for name in used if isinstance(name, str) and name.partition(".")[0] == _PACKAGE} - found
    return found


class _Instruction:
    """A vector instruction that compiled functions may call: see :func:`instruction`."""

    def __init__(self, define: Callable[..., Any], build: FunctionType) -> None:
        self.define, self.build = define, build
        self.machine_code = cache(self._resolve)
        self.digest = cache(self._digest)

    def _resolve(self) -> Any:
        from numba.extending import intrinsic

        return intrinsic(self.define)

    def _digest(self) -> str:
        """Hash of the source files that its code is made from."""
        files = [sys.modules[name].__file__ for name in sorted(_modules_behind(self.build))]
        return hashlib.sha256("".join(_digest_of_file(file) for file in files if file).encode()).hexdigest()


class _Compiled:
    """A function in machine code: compiled at its first call, cached on disk where a folder for that can be written."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.function, self.options = function, options
        self.digest = cache(self._digest)
        # not at import: numba takes most of a second to load
        self.from_python = cache(self._whole)
        self.machine_code = cache(self._part)

    def __call__(self, *arguments: Any) -> Any:
        return self.from_python()(*arguments)

    def entry_point(self, *arguments: Any) -> Callable[..., Any]:
        """The machine code for the types of these arguments; it must be called with the same types.

        It skips numba's dispatch by type, which for many arrays takes as long as a small image.
        """
        import numba

        types = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
        dispatcher: Any = self.from_python()  # once: threads that arrive together may each compile their own
        dispatcher.compile(types)
        entry_point: Callable[..., Any] = dispatcher.overloads[types].entry_point
        return entry_point

    def _globals(self) -> dict[str, Any]:
        """The values of the module's names that the function uses."""
        used = {each.argval for each in dis.get_instructions(self.function) if each.opname == "LOAD_GLOBAL"}
        return {name: value for name, value in self.function.__globals__.items() if name in used}

    def _calls(self) -> dict[str, _Compiled | _Instruction]:
        """The compiled functions that this one calls, by their names in its module."""
        return {name: each for name, each in self._globals().items() if isinstance(each, _Compiled | _Instruction)}

    def _digest(self) -> str:
        """Hash of what the machine code depends on: bytecode, names, options, constants, fields of tuples, callees."""
        code, used = self.function.__code__, self._globals()
        constants = [repr(value) for value in used.values() if isinstance(value, int | float)]
        tuples = [each for each in used.values() if hasattr(each, "_fields")]  # the code has positions of fields
        fields = [f"{each.__module__}.{each.__qualname__}{each._fields}" for each in tuples]
        calls = [each.digest() for each in self._calls().values()]
        own = (code.co_code.hex(), *map(repr, (code.co_consts, code.co_names, self.options)))
        parts = (*own, *constants, *fields, *calls)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _whole(self) -> Any:
        """Numba's dispatcher for calls from Python."""
        from . import one_module
        from .machine_code import CodeCache

        dispatcher = self._dispatcher(pipeline_class=one_module.WholeCompiler)
        with suppress(OSError):  # without a source file there is no telling what else the code depends on
            files = self.function.__code__.co_filename, one_module.__file__
            sources = " ".join(map(_digest_of_file, files))
            identity = f"{self.function.__module__} {dispatcher.py_func.__qualname__} {self.digest()} {sources}"
            dispatcher._cache = CodeCache(dispatcher.py_func.__name__, identity)
        return dispatcher

    def _part(self) -> Any:
        """The same for calls from other compiled functions.

        Without wrappers: to unpack Python's objects takes longer to compile than many a loop.
        """
        from .one_module import PartCompiler

        return self._dispatcher(pipeline_class=PartCompiler, no_cpython_wrapper=True)

    def _dispatcher(self, **options: Any) -> Any:
        import numba

        names = self.function.__globals__ | {name: each.machine_code() for name, each in self._calls().items()}
        function = FunctionType(self.function.__code__, names, self.function.__name__)
        function.__module__ = self.function.__module__
        function.__qualname__ = f"{self.function.__qualname__}_{self.digest()[:16]}_{len(options)}"
        options |= {**self.options, "no_cfunc_wrapper": True}
        dispatcher: Any = numba.njit(**options)(function)
        _forget_literals(dispatcher)
        return dispatcher


@cache
def _digest_of_file(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _forget_literals(dispatcher: Any) -> None:
    """Keeps numba from compiling a function again for each constant that a compiled function calls it with."""
    from numba.core import types

    unliteral: Callable[[Any], Any] = types.unliteral
    template = dispatcher.get_call_template
    dispatcher.get_call_template = lambda arguments, named: template([unliteral(each) for each in arguments], named)


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` in machine code; it may call other compiled functions by their names in its module.

    Each operation is rounded by itself, in the order written: results are the same in every process, and NaN,
    infinities and ties keep their meaning.
    """
    assert isinstance(function, FunctionType)
    return _Compiled(function, _OPTIONS)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same as :func:`borrowing` for a small function that is called often: its code is copied into its callers."""
    assert isinstance(function, FunctionType)
    return _Compiled(function, {**_OPTIONS, "_nrt": False, "forceinline": True})


def borrowing(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same as :func:`compiled` for a function that makes and returns no arrays.

    Numba does not count references to its arguments and their fields: for a row of pixels that can take longer than the
    work on it.
    """
    assert isinstance(function, FunctionType)
    return _Compiled(function, {**_OPTIONS, "_nrt": False})


def instruction(define: Callable[..., Any], build: Callable[..., Any]) -> Callable[..., Any]:
    """A function written in LLVM's instructions, for compiled functions to call.

    Args:
        define: maps numba's typing context and argument types to a signature and a code generator, as
            :func:`numba.extending.intrinsic` takes it.
        build: the function with the instructions; the code is compiled again when its module, or one that it imports
            names from, changes.
    """
    assert isinstance(build, FunctionType)
    return _Instruction(define, build)  # type: ignore[return-value]
