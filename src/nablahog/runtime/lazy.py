"""Packages whose names are found when somebody asks for them, so that importing a package loads none of its parts."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any


class _Package(ModuleType):
    """A package that knows in which of its modules its names are (PEP 562, for :func:`names_when_used`)."""

    _homes: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        homes = self.__dict__["_homes"]
        if name in homes:
            found = getattr(import_module(f"{self.__name__}.{homes[name]}"), name)
            self.__dict__[name] = found
            return found
        # modules can be reached as if they had been loaded, as they have been in most packages
        if not name.startswith("_") and find_spec(f"{self.__name__}.{name}") is not None:
            return import_module(f"{self.__name__}.{name}")
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}", name=name, obj=self)

    def __setattr__(self, name: str, value: Any) -> None:
        # Python sets each module in its package once it is loaded; but `nablahog.hog` is the function
        if not (name in self.__dict__["_homes"] and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.__dict__["_homes"]})


def names_when_used(package: str, **modules: Iterable[str]) -> None:
    """Makes names of modules names of their package, where a module is loaded once one of its names is used.

    A name may be that of a module, too; then it stands for what that name has been given to, never for the module.

    Args:
        package: its ``__name__``, from its ``__init__.py``.
        modules: by the names of modules of the package, the names that they define.
    """
    this = sys.modules[package]
    this.__dict__["_homes"] = {name: module for module, names in modules.items() for name in names}
    this.__class__ = _Package
