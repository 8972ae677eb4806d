"""C++ for Warp functions: the bodies of what Warp's own Python cannot say, a header file each.

A body may ``#include "…"`` other headers, by their paths from this folder. Warp's hash of a kernel is of the whole
text, so that compiled kernels are kept as long as none of it changes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files

_INCLUDE = re.compile(r'^#include "(.+)"$', re.MULTILINE)


def native_code(name: str, constants: Mapping[str, int | float] | None = None) -> str:
    """Return the text of a header for ``wp.func_native``, its includes pasted in, with named constants before it."""
    definitions = (
        f"constexpr {'int' if isinstance(value, int) else 'float'} {key} = {value!r};\n"
        for key, value in (constants or {}).items()
    )
    return "".join(definitions) + _text(name)


def _text(name: str) -> str:
    text = (files(__name__) / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: _text(match[1]), text)
