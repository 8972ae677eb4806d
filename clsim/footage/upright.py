"""How a picture lies as its file stores it, and how it stands: turned and mirrored, by EXIF or a matrix of display.

Sources: CIPA DC-008 (Exif), tag 0x112; ISO/IEC 14496-12, 8.3.2.
"""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

import numpy as np

from clsim.frames.frame import FloatArray

_ORIENTATION = 0x112
_EXIF = re.compile(rb"(?:Exif\0\0|eXIf|EXIF....)(II\*\0|MM\0\*)", re.DOTALL)


class Lie(NamedTuple):
    """What makes a stored picture stand: its rows in reverse if ``mirrored``, then quarter ``turns`` to the left."""

    mirrored: bool = False
    turns: int = 0

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Return width and height of the picture that stands."""
        return (height, width) if self.turns % 2 else (width, height)

    def upright(self, planes: FloatArray) -> FloatArray:
        """Return planes ``[n, H, W]`` as they stand."""
        return np.rot90(planes[:, ::-1] if self.mirrored else planes, self.turns, axes=(1, 2))


_BY_EXIF = {
    2: Lie(True, 2), 3: Lie(False, 2), 4: Lie(True, 0), 5: Lie(True, 3), 6: Lie(False, 3), 7: Lie(True, 1),
    8: Lie(False, 1),
}  # fmt: skip


def of_number(orientation: Any) -> Lie:
    """Return what EXIF's or TIFF's number of an orientation means; others than 2 to 8 mean nothing."""
    return _BY_EXIF.get(orientation, Lie())


def of_exif(data: bytes) -> Lie:
    """Return how a JPEG, PNG or WebP lies."""
    found = _EXIF.search(data)
    if found is None:
        return Lie()
    start, order = found.start(1), "<" if found[1].startswith(b"II") else ">"
    try:
        (at,) = struct.unpack_from(f"{order}I", data, start + 4)
        (count,) = struct.unpack_from(f"{order}H", data, start + at)
        for entry in range(start + at + 2, start + at + 2 + 12 * count, 12):
            tag, _, _, value = struct.unpack_from(f"{order}HHIH", data, entry)
            if tag == _ORIENTATION:
                return of_number(value)
    except struct.error:  # it points beyond its end
        pass
    return Lie()


def of_frame(frame: Any) -> Lie:
    """Return how a decoded frame of a video lies (of PyAV, whose rotation leaves out that a matrix mirrors)."""
    try:
        matrix = frame.side_data.get("DISPLAYMATRIX")
    except ValueError:  # beside it is something that PyAV does not know
        matrix = None
    a, b, _, c, d = struct.unpack_from("<5i", bytes(matrix)) if matrix is not None else (1, 0, 0, 0, 1)
    return Lie(a * d < b * c, round(frame.rotation / 90) % 4)
