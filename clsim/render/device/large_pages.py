"""Memory for what rays read here and there: in large pages, where the system has them.

A processor knows few pages at a time where they lie. With pages of 4 KiB it looks up most places that a ray asks for.
"""

from __future__ import annotations

import contextlib
import mmap
from typing import Any

import numpy as np
import numpy.typing as npt

_PAGE = 1 << 21
"""A large page of most processors [bytes]."""
_LINE = 64
"""Of the processor's cache [bytes]."""
LARGE = 1 << 19
"""What is smaller is not worth a page [bytes]."""


def spread(shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return an array, not initialised, in large pages if it is large; else it starts on a line of the cache."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    alignment = _PAGE if size >= LARGE else _LINE
    # What is never touched costs nothing but addresses, and so there is room for the whole of the last page.
    memory = _fresh(size + 2 * _PAGE) if size >= LARGE else np.empty(size + _LINE, np.uint8)
    start = -memory.ctypes.data % alignment
    return memory[start : start + size].view(dtype).reshape(shape)


def _fresh(size: int) -> npt.NDArray[np.uint8]:
    """Return memory that nobody had before: what was in small pages stays in them."""
    if not hasattr(mmap, "MADV_HUGEPAGE"):  # only Linux is asked
        return np.empty(size, np.uint8)
    pages = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    with contextlib.suppress(OSError):  # of a kernel without them
        pages.madvise(mmap.MADV_HUGEPAGE)
    return np.frombuffer(pages, np.uint8)
