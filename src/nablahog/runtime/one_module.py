"""Numba's compiler for functions that call each other: all of them become one module of LLVM, optimised once.

Numba itself optimises each function and makes machine code of it, and then does both again in every function that
calls it.  Here a *part*, which only compiled functions call, is typed and translated to LLVM's instructions, no more.
A *whole*, which Python calls, is linked with its parts, and parts of these, before LLVM sees it.
"""
# mypy: allow-untyped-calls

from __future__ import annotations

from typing import Any

from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import IRLegalization, NativeLowering, NoPythonBackend

# numba comes without types: Any below stands for its own objects


class _Part(JITCodeLibrary):
    """Instructions of a part, with the libraries of those that it calls."""

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0  # it has no machine code of its own


class _Whole(JITCodeLibrary):
    def finalize(self) -> None:
        self._linking_libraries = list(_with_parts(self._linking_libraries, {}))
        super().finalize()


def _with_parts(libraries: list[Any], known: dict[Any, None]) -> dict[Any, None]:
    """Adds libraries, and those that parts among them call, to the ``known`` ones."""
    for library in libraries:
        if library not in known:
            known[library] = None
            if isinstance(library, _Part):
                _with_parts(library._linking_libraries, known)
    return known


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerWhole(NativeLowering):
    _name = "lower_whole"
    library: type[JITCodeLibrary] = _Whole

    def run_pass(self, state: Any) -> bool:
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        lowered: bool = super().run_pass(state)
        return lowered


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerPart(_LowerWhole):
    _name = "lower_part"
    library = _Part

    def run_pass(self, state: Any) -> bool:
        state.flags.no_compile = True
        lowered = super().run_pass(state)
        # what numba does with functions that it compiles, but for the address in memory
        part, targetctx = state.cr, state.targetctx
        name = part.fndesc.qualname.rpartition(".")[2]
        callee = _dynfunc.make_function(part.fndesc.lookup_module(), name, "", 0, part.env, (state.library,))
        targetctx.insert_user_function(callee, part.fndesc, [state.library])
        state.cr = part._replace(cfunc=callee)
        return lowered


class WholeCompiler(CompilerBase):
    """For functions that Python calls."""

    lowering: type[_LowerWhole] = _LowerWhole

    def define_pipelines(self) -> list[Any]:
        """Numba's own, but for the pass that makes instructions of LLVM."""
        passes = PassManager("nablahog")
        passes.passes += DefaultPassBuilder.define_untyped_pipeline(self.state).passes
        passes.passes += DefaultPassBuilder.define_typed_pipeline(self.state).passes
        passes.add_pass(IRLegalization, "ensure IR is legal prior to lowering")
        passes.add_pass(self.lowering, "lowering")
        passes.add_pass(NoPythonBackend, "result")
        passes.finalize()
        return [passes]


class PartCompiler(WholeCompiler):
    """For functions that only other compiled functions call."""

    lowering = _LowerPart
