"""Packages whose names are looked up when they are first used, so that importing a package loads none of its parts."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from types import FunctionType, ModuleType
from typing import Any

from .text import did_you_mean


class _Package(ModuleType):
    """A package with a table of the modules that define its names (PEP 562), for :func:`names_when_used`."""

    _homes: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        homes = self.__dict__["_homes"]
        if name in homes:
            value = getattr(import_module(f"{self.__name__}.{homes[name]}"), name)
            self.__dict__[name] = value
            self._let_pass(name)
            return value
        # a module of the package needs no import of its own
        if (
            not name.startswith("_")
            and "__path__" in self.__dict__
            and find_spec(f"{self.__name__}.{name}") is not None
        ):
            return import_module(f"{self.__name__}.{name}")
        likely = "" if name[:1] == "_" else did_you_mean(name, (each for each in dir(self) if each[0] != "_"))
        # without obj, or Python would add a suggestion of its own
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}{likely}", name=name)

    def __setattr__(self, name: str, value: Any) -> None:
        # Python sets each module as an attribute of its package once it is loaded, but `nablahog.hog` and
        # `nablahog.render` are functions
        if not (name in self.__dict__["_homes"] and isinstance(value, ModuleType)):
            super().__setattr__(name, value)
        if isinstance(value, ModuleType):
            self._let_pass(name)
            above, _, ours = self.__name__.rpartition(".")
            if isinstance(package := sys.modules.get(above), _Package):
                package._let_pass(ours)

    def _let_pass(self, name: str) -> None:
        """Gives a function that hides a package the package's modules: `import nablahog.hog.kernels as kernels`."""
        value, package = self.__dict__.get(name), sys.modules.get(f"{self.__name__}.{name}")
        if isinstance(value, FunctionType) and package is not None and hasattr(package, "__path__"):
            for below, module in vars(package).items():
                if isinstance(module, ModuleType) and module.__name__ == f"{package.__name__}.{below}":
                    setattr(value, below, module)

    def __dir__(self) -> list[str]:
        names = {
            name
            for name, value in self.__dict__.items()
            if isinstance(value, FunctionType | type) and value.__module__ == self.__name__ and name[0] != "_"
        }
        public = self.__dict__.get("__all__", names)
        return sorted({*public, *(name for name in super().__dir__() if name.startswith("__"))})


def names_when_used(package: str, **modules: Iterable[str]) -> None:
    """Makes names of modules names of their package.  A module is loaded when one of its names is first used.

    Where a name is also that of a module of the package, the name wins, in whatever order things are imported:
    ``nablahog.hog`` is the function, and the package is reached by ``from nablahog.hog import …``.  The function
    has the modules of the package that are loaded, so that ``import nablahog.hog.kernels as kernels`` works, too.

    ``dir()`` shows the names of ``__all__`` alone, or else the functions and classes that are defined there, and the
    error for a wrong name has the nearest of them.  A module without such names is passed for that.
    """
    this = sys.modules[package]
    this.__dict__["_homes"] = {name: module for module, names in modules.items() for name in names}
    this.__class__ = _Package
