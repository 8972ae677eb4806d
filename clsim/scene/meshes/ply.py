"""PLY files before trimesh reads them: what a header declares must fit into its file, and faces must be alike."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.meshes.polygons import F64, I64, triangulated

MAX_HEADER_BYTES = 1 << 20
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_USUAL = re.compile(rb"(?m)[ \t]red[ \t\r]*$")
_COLOR = re.compile(rb"(?m)(?<=[ \t])(?:diffuse_(red|green|blue)|([rgb]))(?=[ \t\r]*$)")
_COORDINATE = re.compile(rb"(?m)(?<=[ \t])texture_([st])(?=[ \t\r]*$)")
_COLORS = {b"r": b"red", b"g": b"green", b"b": b"blue"}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def check_ply(path: Path, data: bytes) -> dict[str, int]:
    """Return how many elements of each kind the header declares.

    Raises:
        InputError: if the header is damaged, or declares more elements than the file has bytes for them.
    """
    head = data[:MAX_HEADER_BYTES]
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise InputError(f"{path}: is not a PLY file (it lacks a header from ply to end_header)")
    counts: dict[str, int] = {}
    lines = head[:end].decode("latin-1").splitlines()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words[:1] != ["element"]:
            continue
        if len(words) != 3 or not words[2].isdecimal():
            raise InputError(f"{path}: line {number}: got {line.strip()!r}, expected an element's name and count")
        counts[words[1]] = int(words[2])
    if counts.get("tristrips") and not counts.get("face"):
        raise InputError(f"{path}: has strips of triangles, expected faces: open it in MeshLab and save it anew")
    body = data[end:].split(b"\n", 1)[-1]
    room = body.count(b"\n") + 1 if any(line.startswith("format ascii") for line in lines) else len(body)
    if sum(counts.values()) > room:
        raise InputError(
            f"{path}: declares {sum(counts.values())} elements, more than it has room for: it is truncated"
        )
    return counts


def usual_names(data: bytes) -> bytes:
    """Return a file that `check_ply` took, with the names that trimesh knows.

    Colours are red, green and blue there (some say r, some diffuse_red), and texture coordinates s and t.
    """
    end = data.find(b"end_header")
    head = _COORDINATE.sub(rb"\1", data[:end])
    if not _USUAL.search(head):
        head = _COLOR.sub(lambda found: found[1] or _COLORS[found[2]], head)
    return head + data[end:]


def even_faces(data: bytes) -> bytes:
    """Return a file that `check_ply` took, with triangles where its faces have different numbers of corners.

    So it has where a fan from its first corner, as trimesh cuts, does not fill a face. trimesh takes all faces of a
    binary file to have as many as the first. Files of another make are left to it.
    """
    end = data.find(b"end_header")
    at = data.find(b"\n", end) + 1
    lines = [line.split() for line in data[:end].decode("latin-1").splitlines()]
    order = next((_ORDERS.get(words[1]) for words in lines if words[:1] == ["format"] and len(words) > 1), None)
    points: F64 | None = None
    elements = [k for k, words in enumerate(lines) if words[:1] == ["element"]]
    if order is None or not elements:
        return data
    for start, stop in zip(elements, [*elements[1:], len(lines)], strict=True):
        properties = [words[1:-1] for words in lines[start:stop] if words[:1] == ["property"]]
        if not all(words and set(words) - {"list"} <= set(_TYPES) for words in properties):
            return data
        types = [[np.dtype(order + _TYPES[word]) for word in words if word != "list"] for words in properties]
        lists = [k for k, each in enumerate(types) if len(each) > 1]
        count = int(lines[start][2])
        if lines[start][1] == "vertex" and not lists and [] not in types:
            names = [words[-1] for words in lines[start:stop] if words[:1] == ["property"]]
            points = _points(data, at, count, names, [each[0] for each in types])
        if lines[start][1] == "face" and len(lists) == 1 and [] not in types:
            number, corner = types[lists[0]]
            before, after = (
                sum(each[0].itemsize for each in part) for part in (types[: lists[0]], types[lists[0] + 1 :])
            )
            found = (
                _triangles(data, at, count, _Face(before, number, corner, after), points)
                if number.kind in "iu"
                else None
            )
            if found is None:
                return data
            lines[start][2] = str(len(found[0]))
            text = "\n".join(" ".join(words) for words in lines)
            header_end = data.find(b"\n", end) + 1
            parts = (
                text.encode("latin-1"),
                b"\nend_header\n",
                data[header_end:at],
                found[0].tobytes(),
                data[found[1] :],
            )
            return b"".join(parts)
        if lists or [] in types:
            return data
        at += count * sum(each[0].itemsize for each in types)
    return data


class _Face(NamedTuple):
    """How a face is written: bytes before its list, types of the list's length and numbers, bytes after the list."""

    before: int
    number: np.dtype[Any]
    corner: np.dtype[Any]
    after: int

    def size(self, corners: int) -> int:
        return self.before + self.number.itemsize + corners * self.corner.itemsize + self.after


def _points(data: bytes, at: int, count: int, names: list[str], types: list[np.dtype[Any]]) -> F64 | None:
    """Return the places of vertices ``[n, 3]``; None where they are not all there, or not finite."""
    size = sum(each.itemsize for each in types)
    if at + count * size > len(data) or not {"x", "y", "z"} <= set(names):
        return None
    starts = dict(zip(names, np.cumsum([0, *(each.itemsize for each in types)]).tolist(), strict=False))
    kinds = dict(zip(names, types, strict=True))
    columns = [np.ndarray((count,), kinds[name], data, at + starts[name], (size,)) for name in "xyz"]
    found = np.stack([column.astype(np.float64) for column in columns], axis=1)
    return found if np.isfinite(found).all() else None


def _cut(points: F64 | None, corners: I64) -> tuple[I64, I64]:
    """Return triangles of faces ``[n, corners]`` of points: which corners ``[m, 3]``, and of which face ``[m]``."""
    count, many = corners.shape
    if points is None or corners.min() < 0 or corners.max() >= len(points):
        fan = np.column_stack([np.zeros(many - 2, np.int64), np.arange(1, many - 1), np.arange(2, many)])
        return np.tile(fan, (count, 1)), np.repeat(np.arange(count), many - 2)
    places, faces = triangulated(points, np.full(count, many), corners.ravel())
    return places - faces[:, None] * many, faces


def _named(rows: npt.NDArray[np.uint8], face: _Face, many: int) -> I64:
    """Return the points of the corners of faces of as many ``[n, many]``, whose bytes are told."""
    first = face.before + face.number.itemsize
    named = np.ascontiguousarray(rows[:, first : first + many * face.corner.itemsize])
    return named.view(face.corner).astype(np.int64)


def _triangles(
    data: bytes, at: int, count: int, face: _Face, points: F64 | None
) -> tuple[npt.NDArray[np.uint8], int] | None:
    """Return the bytes of all faces as those of triangles ``[n, bytes]``, and where the faces end.

    None where all have as many corners and fans fill them, or the file ends before they do.
    """
    if not count or at + face.size(0) > len(data) or _are_alike(data, at, count, face, points):
        return None
    starts, corners = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(count):
        if at + face.size(0) > len(data):
            return None
        starts[k] = at
        corners[k] = many = int(np.frombuffer(data, face.number, 1, at + face.before)[0])
        if many < 0:
            return None
        at += face.size(many)
    if at > len(data):
        return None
    letters = np.frombuffer(data, np.uint8)
    three = np.frombuffer(np.array([3], face.number).tobytes(), np.uint8)
    found = []
    for many in np.unique(corners[corners >= 3]).tolist():
        faces = np.lib.stride_tricks.sliding_window_view(letters, face.size(many))[starts[corners == many]]
        chosen, of_face = _cut(points, _named(faces, face, many))
        first, last = face.size(0) - face.after, face.size(many) - face.after
        corner = faces[:, first:last].reshape(len(faces), many, -1)[of_face[:, None], chosen].reshape(len(chosen), -1)
        head, tail = faces[of_face, : face.before], faces[of_face, last:]
        found.append(np.concatenate([head, np.broadcast_to(three, (len(corner), len(three))), corner, tail], axis=1))
    return (np.concatenate(found), at) if found else None


def _are_alike(data: bytes, at: int, count: int, face: _Face, points: F64 | None) -> bool:
    """Tell whether all faces have as many corners as the first, and fans fill them."""
    many = int(np.frombuffer(data, face.number, 1, at + face.before)[0])
    size = face.size(many)
    if many < 0 or at + count * size > len(data):
        return False
    rows = np.frombuffer(data, np.uint8, count * size, at).reshape(count, size)
    lengths = rows[:, face.before : face.before + face.number.itemsize]
    if not (lengths == lengths[0]).all():
        return False
    return many < 4 or not _cut(points, _named(rows, face, many))[0][:, 0].any()
