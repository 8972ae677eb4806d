"""The methods of detection, one file each: its name is the method's with ``_`` for ``-``, its object METHOD."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from clsim.detect.methods.base import Method


@cache
def method_of(name: str) -> Method:
    """Return the method called ``name``; only then is its code loaded."""
    method: Method = import_module(f"{__name__}.{name.replace('-', '_')}").METHOD
    return method
