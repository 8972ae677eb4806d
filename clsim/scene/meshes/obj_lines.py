"""Lines of OBJ files that trimesh would misread: they are written anew in the plain way, or told."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

from clsim.errors import InputError

_MISREAD = re.compile(rb"\n[ \t]*f(?=((?:[ \t]+[1-9][0-9/]*)*[ \t\r]*))\1(?!\n)")
"""A face of other words than numbers of vertices that count from 1, as those that count back from the line."""
_TABLES = {b"v": "vertex", b"vt": "texture coordinate", b"vn": "normal"}
_QUOTED = 60


def plain_lines(path: Path, data: bytes) -> bytes:
    """Return the file with faces that count from its beginning, each in one line.

    Raises:
        InputError: a vertex is not three numbers, or a face names one that is not there; the message quotes the line.
    """
    goes_on = b"\\\n" in data or b"\\\r\n" in data
    return checked_lines(path, data) if goes_on or _MISREAD.search(b"\n" + data + b"\n") else data


def checked_lines(path: Path, data: bytes) -> bytes:
    """Do what `plain_lines` does line by line, whether or not it is needed.

    Raises:
        InputError: as `plain_lines`.
    """
    lines = re.sub(rb"\\\r?\n", b" ", data).splitlines()
    split = [line.split() for line in lines]
    vertices = sum(words[:1] == [b"v"] for words in split)
    seen = dict.fromkeys(_TABLES, 0)
    for number, words in enumerate(split):
        try:
            if words and words[0] in seen:
                seen[words[0]] += 1
                if words[0] == b"v" and len([float(word) for word in words[1:4]]) < 3:
                    raise ValueError("has fewer than three numbers")
            elif words[:1] == [b"f"]:
                lines[number] = b" ".join([b"f", *(_corner(word, seen, vertices) for word in _uncommented(words[1:]))])
        except ValueError as error:
            quoted = lines[number].strip()[:_QUOTED].decode("utf-8", "replace")
            raise InputError(f"{path}: the line {quoted!r} {_reason(error)}") from None
    return b"\n".join(lines) + b"\n"


def _uncommented(words: list[bytes]) -> list[bytes]:
    return list(itertools.takewhile(lambda word: not word.startswith(b"#"), words))


def _reason(error: ValueError) -> str:
    said = str(error)
    return said if said.startswith(("has ", "names ")) else "has something else where numbers are expected"


def _corner(word: bytes, seen: dict[bytes, int], vertices: int) -> bytes:
    """Return what a corner names, counted from the file's beginning: negative numbers count back from the line."""
    if b"-" in word:
        word = b"/".join(_absolute(place, *table) for place, table in zip(word.split(b"/"), seen.items(), strict=False))
    vertex = int(word.partition(b"/")[0])
    if not 1 <= vertex <= vertices:
        raise ValueError(f"names vertex {vertex}, of {vertices}")
    return word


def _absolute(place: bytes, kind: bytes, seen: int) -> bytes:
    at = int(place) if place else 0
    if at >= 0:
        return place
    if seen + at < 0:
        raise ValueError(f"names {_TABLES[kind]} {at}, of {seen} above it")
    return str(seen + 1 + at).encode()
