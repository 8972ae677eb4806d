"""Texts of options: the docstrings of the fields that they set, which are read from the source, for speed."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from clsim.cli.spelling import as_options

_SOURCES = ("live/footage.py", "live/sensors.py", "detect/config.py", "events/outputs.py", "live/settings.py")
"""Where fields are described; of several of one name the last is meant, and others with their class."""
_FIELD = re.compile(r'^    (\w+): [^\n=]+(?: = (\S+))?\n    """(.*?)(?:\n\n.*?)?"""$', re.MULTILINE | re.DOTALL)
_BRACKET = re.compile(r"(.*?)(?: \[([^\]]*)\])?")


@cache
def _fields() -> dict[str, tuple[str, str]]:
    """Return the default of each field and the first paragraph of its docstring, as they are written."""
    package = Path(__file__).parents[2]
    found = {}
    for source in _SOURCES:
        for block in (package / source).read_text(encoding="utf-8").split("\nclass ")[1:]:
            kind = re.split(r"\W", block, maxsplit=1)[0]
            for name, default, text in _FIELD.findall(block):
                found[name] = found[f"{kind}.{name}"] = default, text
    return found


def told(field: str, written: str = "", default: str | None = None) -> str:
    """Return a field's text and its default, in brackets.

    Args:
        field: its name, or CLASS.NAME.
        written: a sentence on how a value is written on a command line.
        default: what holds where the option is not given, if that is not the field's own.
    """
    value, text = _fields()[field]
    matched = _BRACKET.fullmatch(as_options(" ".join(text.split()).replace("``", "`")))
    assert matched is not None
    own = {"True": "yes", "False": "", "None": "", "()": ""}.get(value, value.strip('"').removesuffix(".0"))
    bracket = default or matched[2] or own
    return " ".join(part for part in (matched[1], written, f"[{bracket}]" if bracket else "") if part)
