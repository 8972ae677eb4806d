"""Pages made from the code: a comment ``<!-- made: WHAT -->`` in a page is replaced by what the code tells.

``commands`` are all commands of the command line, from its own parser. ``api MODULE`` is what a module exports.
``source FILE`` is the text of a file.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer.main

MARK = re.compile(r"<!-- made: (commands|api|source) ?([\w./]*) ?(#*) -->")
_ROOT = Path(__file__).parents[2]


def filled(text: str) -> str:
    """Return a page with its marks replaced."""
    return MARK.sub(_made, text)


def _made(mark: re.Match[str]) -> str:
    if mark[1] == "source":
        return f"```python\n{(_ROOT / mark[2]).read_text(encoding='utf-8')}```"
    return commands() if mark[1] == "commands" else api(mark[2], mark[3])


def commands() -> str:
    """Return all commands with their options, a section each."""
    from clsim.cli.app import app

    return "\n".join(line for name, each in _leaves(typer.main.get_command(app)) for line in _command(name, each))


def api(module: str, heading: str) -> str:
    """Return directives that document what a module exports: the names in ``__all__``, or all that it defines.

    Args:
        module: its full name.
        heading: signs before the name of each export.
    """
    from sphinx.ext.autodoc.mock import mock

    with mock(["torch"]):
        found = import_module(module)
    names = getattr(found, "__all__", None)
    if names is None:
        return _rst(f".. automodule:: {module}\n   :members:\n   :no-index:")
    parts = [
        f"{heading} {module}.{name}\n\n{_export(name, getattr(found, name))}"
        for name in names
        if not name.startswith("_")
    ]
    return "\n\n".join(parts)


def _leaves(command: Any, path: str = "clsim") -> Iterator[tuple[str, Any]]:
    """Go over the commands that take options, with their full names."""
    if not hasattr(command, "commands"):
        yield path, command
        return
    if command.params and getattr(command, "invoke_without_command", False) and path != "clsim":
        yield path, command
    for name, below in command.commands.items():
        yield from _leaves(below, f"{path} {name}")


def _command(name: str, command: Any) -> Iterator[str]:
    yield from (f"## {name}", "", inspect.cleandoc(command.help or "").partition("\f")[0], "")
    arguments = [each for each in command.params if each.param_type_name == "argument"]
    if arguments:
        yield from (f"`{name} {' '.join(map(_place, arguments))}`", "")
        yield from (f"- `{each.name.upper()}`: {_words(each)}" for each in arguments if each.help)
        yield ""
    options = [each for each in command.params if each.param_type_name == "option" and not each.hidden]
    groups: dict[str, list[Any]] = {}
    for each in options:
        groups.setdefault(getattr(each, "rich_help_panel", None) or "", []).append(each)
    for panel, members in groups.items():
        if panel:
            yield from (f"*{panel}*", "")
        yield from ("| option | value | meaning |", "|---|---|---|")
        yield from (f"| {_spelled(each)} | {_values(each)} | {_words(each)} |" for each in members)
        yield ""


def _place(argument: Any) -> str:
    name = (argument.metavar or argument.name).upper() + ("…" if argument.nargs == -1 else "")
    return name if argument.required else f"[{name}]"


def _spelled(option: Any) -> str:
    return ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))


def _values(option: Any) -> str:
    if option.is_flag:
        return ""
    if option.metavar:
        return f"`{option.metavar}`".replace("|", "\\|")
    kind = option.type_descriptor.annotation
    if get_origin(kind) is Literal:
        return ", ".join(f"`{each}`" for each in get_args(kind))
    kind = get_args(kind)[0] if get_origin(kind) is list else kind
    return {int: "whole number", float: "number", Path: "file", str: "text"}.get(
        kind, getattr(kind, "__name__", "text")
    )


def _words(each: Any) -> str:
    return " ".join((each.help or "").replace("|", "\\|").split())


def _export(name: str, value: Any) -> str:
    """Return what documents one export, by the place where it is defined."""
    if inspect.isclass(value):
        where = f"{value.__module__}.{value.__qualname__}\n   :no-index:\n   :members:"
        if issubclass(value, BaseException):
            return _rst(f".. autoexception:: {where}")
        return _rst(f".. autoclass:: {where}\n   :inherited-members: Sequence, Iterator, Protocol, ABC, object")
    if inspect.isroutine(value):
        return _rst(f".. autofunction:: {value.__module__}.{value.__qualname__}\n   :no-index:")
    return _rst(_comment(name) or f"A constant of type `{type(value).__name__}`.")


def _comment(name: str) -> str:
    """Return the text below the line that defines a constant, or a name for a type."""
    from sphinx.errors import PycodeError
    from sphinx.pycode import ModuleAnalyzer

    for module in [module for module in sys.modules if module.startswith("clsim.")]:
        try:
            told = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name))
        except PycodeError:
            continue
        if told:
            return "\n".join(told)
    return ""


def _rst(text: str) -> str:
    return f"```{{eval-rst}}\n{text}\n```"
