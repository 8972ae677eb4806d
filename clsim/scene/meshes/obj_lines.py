"""Lines of OBJ files that trimesh would misread: they are written anew in the plain way, or told."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.scene.meshes.obj_plain import parsed
from clsim.scene.meshes.polygons import cut_anew, triangulated

_MISREAD = re.compile(rb"\n[ \t]*f(?=((?:[ \t]+[1-9][0-9/]*)*[ \t\r]*))\1(?!\n)")
"""A face of other words than numbers of vertices that count from 1, as those that count back from the line."""
_INDENT = re.compile(rb"(?m)^[ \t]+")
_COMMENTED = re.compile(rb"\n[ \t]*v[nt]?[ \t][^\n#]*#")
_POLYGON = re.compile(rb"(?m)^[ \t]*f((?:[ \t]+[0-9/]+){4,})[ \t\r]*$")
_VERTEX = re.compile(rb"(?m)^[ \t]*v[ \t]+((?:[^ \t\r\n]+[ \t]*){0,3})")
_LEFT_OUT = {
    "curves and curved surfaces are left out": (re.compile(rb"(?m)^[ \t]*(?:curv2?|surf)[ \t]"), None),
    "groups of smooth faces are flat, since the file has no normals": (
        re.compile(rb"(?m)^[ \t]*s[ \t]+[1-9]"),
        re.compile(rb"(?m)^[ \t]*vn[ \t]"),
    ),
}
"""What a file may ask for, and lines by which it does, unless there are others."""
_TABLES = {b"v": "vertex", b"vt": "texture coordinate", b"vn": "normal"}
_QUOTED = 60


def plain_lines(path: Path, data: bytes) -> bytes:
    """Return the file with faces that count from its beginning, each in one line, and no concave polygons.

    Raises:
        InputError: a vertex is not three numbers, or a face names one that is not there; the message quotes the line.
    """
    if b"\n " in data or b"\n\t" in data:  # trimesh passes over lines that do not begin with their word
        data = _INDENT.sub(b"", data)
    goes_on = b"\\\n" in data or b"\\\r\n" in data
    if goes_on or _MISREAD.search(b"\n" + data + b"\n") or _COMMENTED.search(b"\n" + data):
        data = checked_lines(path, data)
    return without_concave(data)


def left_out(data: bytes) -> list[str]:
    """Return what a file asks for and does not get."""
    return [
        told for told, (asks, unless) in _LEFT_OUT.items() if asks.search(data) and not (unless and unless.search(data))
    ]


def without_concave(data: bytes) -> bytes:
    """Return the file with triangles in place of polygons that a fan from their first corner does not fill."""
    polygons = list(_POLYGON.finditer(data))
    if not polygons:
        return data
    corners = [polygon[1].split() for polygon in polygons]
    counts = np.array([len(each) for each in corners], np.int64)
    vertices = _VERTEX.findall(data)
    found = parsed(b" ".join(vertices), np.float64)
    named = parsed(re.sub(rb"/[0-9/]*", b"", b" ".join(polygon[1] for polygon in polygons)), np.int64)
    # Where numbers are lacking, who reads the file next says so.
    if found is None or named is None or len(found) != 3 * len(vertices) or len(named) != counts.sum():
        return data
    points, indices = found.reshape(-1, 3), named - 1
    if not np.isfinite(points).all() or indices.min() < 0 or indices.max() >= len(points):
        return data
    triangles, faces = triangulated(points, counts, indices)
    parts, end = [], 0
    for face, cut in cut_anew(triangles, faces, counts):
        lines = b"\n".join(b" ".join([b"f", *(corners[face][k] for k in triangle)]) for triangle in cut)
        parts += [data[end : polygons[face].start()], lines]
        end = polygons[face].end()
    return b"".join([*parts, data[end:]])


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
                words = _uncommented(words)
                lines[number] = b" ".join(words)
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
