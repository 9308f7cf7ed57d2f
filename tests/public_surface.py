"""The public surface as plain data: names, kinds, signatures and the command's arguments, for test_generated.py."""

from __future__ import annotations

import argparse
import inspect
import re
from types import ModuleType
from typing import Any

import nablahog
from nablahog.cli.main import parser


def surface() -> dict[str, Any]:
    """Every public name of ``nablahog``, with its kind and its signature or what is public in it."""
    names = {name: describe(getattr(nablahog, name)) for name in sorted(nablahog.__all__) if name != "__version__"}
    return {**names, "command line": commands(parser())}


def commands(of: argparse.ArgumentParser) -> dict[str, Any]:
    """The arguments of each command, as --help names them, with their defaults and choices."""
    found: dict[str, Any] = {}
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            found |= {name: commands(each) for name, each in action.choices.items()}
        elif action.default != argparse.SUPPRESS:
            name = ", ".join(action.option_strings) or str(action.metavar or action.dest)
            choices = "" if action.choices is None else f" of {', '.join(map(str, action.choices))}"
            found[name] = f"{action.default!r}{choices}"
    return found


def members(of: ModuleType) -> dict[str, Any]:
    """The public names of a module: those of ``__all__``, or else the functions and classes that it defines."""
    if hasattr(of, "__all__"):
        return {name: getattr(of, name) for name in sorted(of.__all__)}
    own = {name: value for name, value in vars(of).items() if getattr(value, "__module__", None) == of.__name__}
    public = {name: value for name, value in own.items() if name[0] != "_" and callable(value)}
    return {
        name: public[name] for name in sorted(public) if inspect.isclass(own[name]) or inspect.isfunction(own[name])
    }


def describe(value: Any) -> Any:
    """One name: a module by its members, a class by its constructor and what this package adds to it."""
    if isinstance(value, ModuleType):
        return {"kind": "module", "members": {name: describe(member) for name, member in members(value).items()}}
    if inspect.isclass(value):
        ours = [vars(base) for base in reversed(value.__mro__) if base.__module__.startswith("nablahog")]
        own = {name: member for each in ours for name, member in each.items() if not name.startswith("_")}
        shown = {name: _member(own[name]) for name in sorted(own)}
        return {"kind": "class", "signature": _signature(value), "members": {n: m for n, m in shown.items() if m}}
    return {"kind": "function", "signature": _signature(value)} if callable(value) else {"kind": type(value).__name__}


def _member(value: Any) -> str | None:
    if isinstance(value, classmethod | staticmethod):
        return f"{type(value).__name__} {_signature(value.__func__)}"
    if inspect.isfunction(value):
        return _signature(value)
    return "property" if isinstance(value, property) or hasattr(value, "__get__") else None


def _signature(of: Any) -> str:
    try:
        return re.sub(r" at 0x[0-9a-f]+", "", str(inspect.signature(of)))
    except ValueError:  # built in
        return "()"
