"""Whether files of video end where their containers say: what tells of a cut that no header's length does."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

_TS_SYNC = 0x47
_TS_TAIL = 4 << 20
"""Bytes at the end of a transport stream in which the last frame begins."""
_MOST_BOXES = 1_000_000


def cut_end(where: str, container: str) -> str | None:
    """Return what is missing at the end of a file, as half a sentence; None where it is whole, or nothing tells.

    Args:
        where: the file.
        container: libav's name of its format.
    """
    checks: dict[str, Callable[[BinaryIO, int], str | None]] = {"mp4": _mp4, "mov": _mp4, "mpegts": _mpegts}
    check = next((checks[name] for name in container.split(",") if name in checks), None)
    if check is None:
        return None
    with Path(where).open("rb") as file:
        return check(file, file.seek(0, 2))


def _mp4(file: BinaryIO, size: int) -> str | None:
    """Look at the boxes at the top (ISO/IEC 14496-12): each tells its length, fragments of a live film too."""
    at = 0
    for _ in range(_MOST_BOXES):
        if at == size:
            return None
        file.seek(at)
        head = file.read(16)
        if len(head) < 8:
            return "ends within the head of a box"
        length, kind = struct.unpack(">I4s", head[:8])
        if length == 1 and len(head) == 16:
            (length,) = struct.unpack(">Q", head[8:])
        if length == 0:  # as far as the file goes
            return None
        if length < 8 or not kind.isascii():
            return None  # no box: other readers stop here too
        if at + length > size:
            return f"lacks {at + length - size} of the {length} bytes of its last box ({kind.decode()})"
        at += length
    return None


def _mpegts(file: BinaryIO, size: int) -> str | None:
    """Look at the last packets (ISO/IEC 13818-1): whether they are whole, and so is the last frame in them."""
    file.seek(0)
    head = file.read(1024)
    step = next((n for n in (188, 192, 204) if len(head) > 2 * n and _synced(head, n)), None)
    if step is None:
        return None
    if size % step:
        return f"lacks {step - size % step} of the {step} bytes of its last packet"
    first = max(0, size - _TS_TAIL) // step * step
    file.seek(first)
    data = file.read()
    lead = 4 if step == 192 else 0
    open_pes: dict[int, int] = {}
    for at in range(lead, len(data), step):
        packet = data[at : at + 188]
        if len(packet) < 188 or packet[0] != _TS_SYNC:
            return None
        pid, starts = (packet[1] & 0x1F) << 8 | packet[2], bool(packet[1] & 0x40)
        skipped = 4 + (1 + packet[4] if packet[3] & 0x20 else 0)
        payload = packet[skipped:] if packet[3] & 0x10 else b""
        if starts and payload[:3] == b"\0\0\1" and len(payload) >= 6:
            told = struct.unpack(">H", payload[4:6])[0]
            open_pes[pid] = told + 6 - len(payload) if told else 0
        elif open_pes.get(pid, 0) > 0:
            open_pes[pid] -= len(payload)
    missing = max(open_pes.values(), default=0)
    return f"lacks {missing} bytes of its last frame" if missing > 0 else None


def _synced(head: bytes, step: int) -> bool:
    lead = 4 if step == 192 else 0
    return all(head[at] == _TS_SYNC for at in range(lead, min(len(head), 3 * step), step))
