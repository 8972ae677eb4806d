"""Keys of cached results: a digest of everything that went in."""

from __future__ import annotations

import dataclasses
import hashlib
import struct
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from clsim.scene import World

if TYPE_CHECKING:
    from importlib.abc import Traversable

FRAME_ROOMS = ("frames", "events", "scene", "render", "detect", "kernels")
"""Packages whose source decides which events a scene gives."""
_DEPENDENCIES = ("numpy", "pyopencl", "warp-lang")
_LENGTH = 24


def content_key(*values: Any) -> str:
    """Return a digest of nested values: numbers, texts, arrays, containers, dataclasses and plain objects.

    Equal contents give equal keys in every process. Types count: 1 and 1.0 differ.

    Raises:
        TypeError: a value is of a kind whose contents cannot be seen.
    """
    digest = hashlib.sha256()
    _feed(digest, values)
    return digest.hexdigest()[:_LENGTH]


def world_key(world: World) -> str:
    """Return the digest of what a world looks like; its name, and sentences about its file, do not count."""
    return content_key(dataclasses.replace(world, name="", warnings=(), notes=()))


@lru_cache(maxsize=4)
def code_key(rooms: tuple[str, ...]) -> str:
    """Return the digest of clsim's version, of the source files of some of its packages, and of what they stand on."""
    from clsim import __version__

    sources = {name: content for room in rooms for name, content in _sources(files(f"clsim.{room}"), room)}
    return content_key(__version__, sources, {name: _installed(name) for name in _DEPENDENCIES})


def _sources(folder: Traversable, path: str) -> Iterator[tuple[str, bytes]]:
    """Yield the source files of a folder and of those in it, each with its path."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _sources(entry, f"{path}/{entry.name}")
        elif entry.name.endswith((".py", ".cl", ".clh", ".h")):
            yield f"{path}/{entry.name}", entry.read_bytes()


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _feed(digest: Any, value: Any) -> None:
    """Add one value, with its type and length first, so that neighbours cannot run into each other."""
    if value is None or isinstance(value, bool | int | str | bytes):
        _feed_bytes(digest, type(value).__name__, value if isinstance(value, bytes) else str(value).encode())
    elif isinstance(value, float):
        _feed_bytes(digest, "float", struct.pack("<d", value))
    elif isinstance(value, np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        _feed_bytes(digest, f"array {array.dtype.str} {array.shape}", array.tobytes())
    elif isinstance(value, Mapping):
        _feed_items(digest, "mapping", sorted(value.items()))
    elif isinstance(value, tuple | list):
        _feed_items(digest, "sequence", value)
    elif dataclasses.is_dataclass(value):
        pairs = [(field.name, getattr(value, field.name)) for field in dataclasses.fields(value)]
        _feed_items(digest, type(value).__qualname__, pairs)
    elif hasattr(value, "__dict__"):
        # What an object remembers of its last use is not content.
        _feed_items(digest, type(value).__qualname__, sorted(p for p in vars(value).items() if p[0] != "_cache"))
    else:
        raise TypeError(f"cannot see the contents of a {type(value).__name__}")


def _feed_bytes(digest: Any, kind: str, data: bytes) -> None:
    digest.update(f"{kind} {len(data)}:".encode())
    digest.update(data)


def _feed_items(digest: Any, kind: str, items: Any) -> None:
    digest.update(f"{kind} {len(items)}:".encode())
    for item in items:
        _feed(digest, item)
