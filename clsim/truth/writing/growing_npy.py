"""Files of numpy's own format that grow by rows: what was appended is readable at any time, also after a kill."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt


class GrowingNpy:
    """An array ``[count, *shape]`` in a file.

    Attributes:
        count: rows so far.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], kind: str) -> None:
        """Create the file without rows; raises OSError when it cannot be."""
        self._shape, self._kind, self.count = shape, np.dtype(kind), 0
        self._file = path.open("wb", buffering=0)
        self._head = len(self._header())
        self._file.write(self._header())

    def append(self, rows: npt.NDArray[Any]) -> None:
        """Append rows, then the count that promises them; raises OSError when the medium fails."""
        data = np.ascontiguousarray(rows, self._kind)
        self._put(data.tobytes(), self._head + self.count * self._kind.itemsize * int(np.prod(self._shape)))
        self.count += len(data)
        self._put(self._header(), 0)

    def close(self) -> None:
        """Release the file; safe to call twice."""
        self._file.close()

    def _put(self, data: bytes, offset: int) -> None:
        self._file.seek(offset)
        view = memoryview(data)
        while len(view):
            view = view[self._file.write(view) :]

    def _header(self) -> bytes:
        """Return the file's head, which has the same length whatever the count: numpy leaves room for it to grow."""
        out = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            out, {"descr": self._kind.str, "fortran_order": False, "shape": (self.count, *self._shape)}
        )
        return out.getvalue()
