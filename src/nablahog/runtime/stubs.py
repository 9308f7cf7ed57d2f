"""Public names of a package from its stub, ``__init__.pyi`` (SPEC 1 of Scientific Python), loaded when first used."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.resources import as_file, files
from importlib.util import find_spec
from types import FunctionType
from typing import Any

import lazy_loader

from .text import did_you_mean


def attach(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """The ``__getattr__``, ``__dir__`` and ``__all__`` of a package: the names of its stub, none of them loaded.

    A module of the package that the stub does not name is also there without an import of its own.

    Where a function has the name of a package, such as ``nablahog.hog``, the function wins in whatever order things are
    imported: :mod:`lazy_loader` keeps the import system from setting the package in its place.
    """
    with as_file(files(package) / "__init__.pyi") as stub:  # of a package in a zip file, a temporary copy
        attribute, names, public = lazy_loader.attach_stub(package, str(stub))

    def find(name: str) -> Any:
        module = f"{package}.{name}"
        if name not in public:
            if name.isidentifier() and not name.startswith("_") and find_spec(module) is not None:
                return import_module(module)
            raise AttributeError(f"module {package!r} has no attribute {name!r}{did_you_mean(name, public)}")
        value = attribute(name)
        if isinstance(value, FunctionType) and module in sys.modules and hasattr(sys.modules[module], "__path__"):
            # `import nablahog.hog.kernels as kernels` takes attributes, not modules, from left to right
            value.__dict__ = vars(sys.modules[module])
        return value

    return find, names, public
