"""OBJ files of triangles alone, read at once: of such are scenes of many files made.

Each line says one thing in the plainest way: ``v`` with three numbers, ``vt`` with two or three, ``vn`` with three,
``f`` with three corners that all name the same. What is written in any other way is left to trimesh, which takes
longer, and about half a second to be imported.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.scene.world import Mesh

_KINDS = (b"v ", b"vt ", b"vn ", b"f ")
_IGNORED = (b"#", b"s ", b"o ", b"g ", b"usemtl ", b"mtllib ")
_NAMED = {(0, False): ("v",), (3, False): ("v", "vt"), (6, True): ("v", "vn"), (6, False): ("v", "vt", "vn")}
"""What corners name, by the slashes of a line and whether two stand together: 1, 1/2, 1//3 and 1/2/3."""
I64 = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Lines:
    """All lines of a kind: what follows the kind, one after the other, and how many they are.

    ``spaces`` and ``slashes`` are those of each line, or −1 where lines have not as many.
    """

    text: bytes
    count: int
    spaces: int
    slashes: int


def read_plain_obj(data: bytes) -> Mesh | None:
    """Return the file's triangles as one mesh of material 0; None where a line is not of the plain kind.

    A vertex is made of each combination of position, texture coordinates and normal that a triangle names.
    """
    if data.count(b"usemtl") > 1:  # trimesh parts them by material, and so puts them in another order
        return None
    lines = _sorted_lines(data)
    corners = lines and _corners(lines[b"f "])
    if not lines or not corners:
        return None
    tables: dict[str, F64] = {}
    for name, at in corners.items():
        table = _numbers(lines[name.encode() + b" "], (2, 3) if name == "vt" else (3,))
        if table is None or at.min() < 1 or at.max() > len(table) or not np.isfinite(table).all():
            return None
        tables[name] = table
    chosen, triangles = _combined(list(corners.values()))
    found = {name: tables[name][at.ravel()[chosen] - 1] for name, at in corners.items()}
    return Mesh(
        vertices=np.ascontiguousarray(found["v"], np.float32),
        triangles=np.ascontiguousarray(triangles, np.int32),
        material_ids=np.zeros(len(triangles), np.int32),
        normals=unit_normals(found["vn"]) if "vn" in found else None,
        uvs=np.ascontiguousarray(found["vt"][:, :2], np.float32) if "vt" in found else None,
    )


def unit_normals(normals: F64) -> npt.NDArray[np.float32]:
    """Return normals of unit length; those without length point up."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0))
    return np.ascontiguousarray(unit, np.float32)


def _sorted_lines(data: bytes) -> dict[bytes, _Lines] | None:
    """Return the lines of each kind; None where one is of none, and not of those that say nothing of triangles."""
    if b"\r" in data or b"\t" in data or b"  " in data or b" \n" in data:
        data = b"\n".join(b" ".join(line.split()) for line in data.splitlines())
    data += b"\n  "
    letters = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(letters == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    spaces, slashes = (np.diff(np.searchsorted(np.flatnonzero(letters == ord(sign)), ends), prepend=0) for sign in " /")
    kinds = np.full(len(ends), -1)
    for number, kind in enumerate(_KINDS):
        is_kind = letters[starts] == kind[0]
        for k in range(1, len(kind)):
            is_kind &= letters[starts + k] == kind[k]
        kinds[is_kind] = number
    others = np.flatnonzero((kinds < 0) & (ends > starts))
    if not all(data.startswith(_IGNORED, start) for start in starts[others]):
        return None
    firsts = np.flatnonzero(np.diff(kinds, prepend=-2))
    runs = list(zip(kinds[firsts], starts[firsts], ends[np.append(firsts[1:], len(ends)) - 1], strict=True))
    found = {}
    for number, kind in enumerate(_KINDS):
        texts = [data[start + len(kind) : end].replace(b"\n" + kind, b" ") for n, start, end in runs if n == number]
        mine = kinds == number
        found[kind] = _Lines(b" ".join(texts), int(mine.sum()), _common(spaces[mine]), _common(slashes[mine]))
    return found


def _common(counts: I64) -> int:
    """Return what all are, or −1."""
    return int(counts[0]) if len(counts) and (counts == counts[0]).all() else -1


def _numbers(lines: _Lines, widths: tuple[int, ...]) -> F64 | None:
    """Return the numbers of lines that all have as many, which may be one of ``widths``; None of others."""
    numbers = parsed(lines.text, np.float64) if lines.spaces in widths else None
    return None if numbers is None or len(numbers) != lines.spaces * lines.count else numbers.reshape(lines.count, -1)


def _corners(lines: _Lines) -> dict[str, I64] | None:
    """Return what the corners of triangles name, by tables' names ``[n, 3]``, counted from 1."""
    double = lines.text.count(b"//")
    named = _NAMED.get((lines.slashes, double > 0))
    if named is None or lines.spaces != 3 or double not in (0, 3 * lines.count):
        return None
    numbers = parsed(lines.text.replace(b"/", b" "), np.int64)
    if numbers is None or len(numbers) != 3 * len(named) * lines.count:
        return None
    corners = numbers.reshape(-1, 3, len(named))
    return {name: corners[:, :, k] for k, name in enumerate(named)}


def parsed(text: bytes, kind: type[Any]) -> npt.NDArray[Any] | None:
    """Return the numbers in a text with spaces or ends of lines between them; None of what has others."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older numpy only warns of text that is no number
        try:
            return np.fromstring(text, kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _combined(corners: Sequence[I64]) -> tuple[I64, I64]:
    """Return where each combination of numbers stands first, by the first number, and triangles of them."""
    key = corners[0].ravel().copy()
    for at in corners[1:]:
        key = key * (int(at.max()) + 1) + at.ravel()
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1, 3)
