"""A PLY file's header, read before its data: what it declares must fit into the file."""

from __future__ import annotations

from pathlib import Path

from clsim.errors import InputError

MAX_HEADER_BYTES = 1 << 20


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
    body = data[end:].split(b"\n", 1)[-1]
    room = body.count(b"\n") + 1 if any(line.startswith("format ascii") for line in lines) else len(body)
    if sum(counts.values()) > room:
        raise InputError(
            f"{path}: declares {sum(counts.values())} elements, more than it has room for: it is truncated"
        )
    return counts
