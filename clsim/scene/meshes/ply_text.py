"""PLY files of text whose faces a fan from their first corner does not fill: trimesh cuts no other way."""

from __future__ import annotations

import re

import numpy as np

from clsim.scene.meshes.obj_plain import parsed
from clsim.scene.meshes.polygons import cut_anew, triangulated


def without_concave(data: bytes) -> bytes:
    """Return a PLY file of text with triangles in place of such faces.

    Files whose faces have further lists, or do not come right after the vertices, are returned as they are.
    """
    end = data.find(b"end_header")
    head = [line.split() for line in data[:end].decode("latin-1").splitlines()]
    starts = [k for k, words in enumerate(head) if words[:1] == ["element"]]
    text = ["format", "ascii"] in [words[:2] for words in head]
    if not text or [head[k][1] for k in starts[:2]] != ["vertex", "face"]:
        return data
    vertex, face = (
        [words for words in head[start:stop] if words[:1] == ["property"]]
        for start, stop in zip(starts[:2], [*starts[1:], len(head)], strict=False)
    )
    names, lists = [words[-1] for words in vertex], [words[1:2] == ["list"] for words in face]
    count, many = (int(head[k][2]) for k in starts[:2])
    body = data.find(b"\n", end) + 1
    lines = data[body:].splitlines()
    faces = [line.split() for line in lines[count : count + many]]
    polygons = [k for k, words in enumerate(faces) if words and words[0].isdigit() and int(words[0]) > 3]
    if not polygons or not {"x", "y", "z"} <= set(names) or lists[:1] != [True] or any(lists[1:]):
        return data
    counts = np.array([int(faces[k][0]) for k in polygons])
    corners = [faces[k][1 : 1 + size] for k, size in zip(polygons, counts.tolist(), strict=True)]
    values = parsed(b" ".join(lines[:count]), np.float64)
    named = parsed(b" ".join(b" ".join(each) for each in corners), np.int64)
    # Where numbers are lacking, who reads the file next says so.
    if values is None or named is None or values.size != count * len(names) or named.size != counts.sum():
        return data
    points = values.reshape(count, -1)[:, [names.index(axis) for axis in "xyz"]]
    if not np.isfinite(points).all() or named.min() < 0 or named.max() >= count:
        return data
    triangles, of_polygon = triangulated(points, counts, named)
    for number, cut in cut_anew(triangles, of_polygon, counts):
        tail = faces[polygons[number]][1 + len(corners[number]) :]
        written = [b" ".join([b"3", *(corners[number][k] for k in each), *tail]) for each in cut]
        lines[count + polygons[number]] = b"\n".join(written)
        many += len(cut) - 1
    told = re.sub(rb"(?m)^(element[ \t]+face[ \t]+)\d+", rb"\g<1>%d" % many, data[:body])
    return told + b"\n".join(lines) + b"\n"
