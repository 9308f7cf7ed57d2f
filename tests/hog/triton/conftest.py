"""Triton's interpreter runs the kernels on a CPU, see ``tests/conftest.py``; a GPU, where there is one, without it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
import torch

if find_spec("triton") is None:
    collect_ignore_glob = ["test_*.py"]

elif os.environ.get("TRITON_INTERPRET") == "1":
    from triton.language.semantic import TritonSemantic
    from triton.runtime import interpreter

    # It prepares Triton's language for itself at every call of one function by another, and checks all sums of
    # integers for overflow: together most of the time of these tests.  Once for each of Triton's modules is enough.
    _prepared: set[str] = set()
    _prepare_and_call = interpreter.InterpretedFunction.__call__

    def _call(self: Any, *args: Any, **kwargs: Any) -> Any:
        module = self.fn.__module__
        if module.startswith("triton.") and module not in _prepared:
            _prepared.add(module)
            return _prepare_and_call(self, *args, **kwargs)
        return self.rewrite()(*args, **kwargs)

    # Triton 3.6 to 3.8 take the bounds of loops from arrays of one number in a way that NumPy warns of, or refuses.
    _prepare_tensor = interpreter._patch_lang_tensor

    def _prepare_tensor_and_index(tensor: Any, scope: Any) -> None:
        _prepare_tensor(tensor, scope)
        scope.set_attr(tensor, "__index__", lambda self: self.handle.data.item())

    _broadcast = TritonSemantic.broadcast_impl_value

    def _broadcast_if_needed(self: Any, lhs: Any, rhs: Any) -> Any:
        same = lhs.type.is_block() and rhs.type.is_block() and lhs.handle.data.shape == rhs.handle.data.shape
        return (lhs, rhs) if same else _broadcast(self, lhs, rhs)

    interpreter.InterpretedFunction.__call__ = _call
    interpreter._patch_lang_tensor = _prepare_tensor_and_index
    TritonSemantic.broadcast_impl_value = _broadcast_if_needed
    interpreter.interpreter_builder.options = interpreter.InterpreterOptions(sanitize_overflow=False)

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


@pytest.fixture(autouse=True)
def _no_warnings_of_numpy() -> Iterator[None]:
    """The interpreter computes with NumPy, which warns of infinity and of lanes that are masked later."""
    with np.errstate(all="ignore"):
        yield
