"""The Frame: what a renderer writes and a detector reads.

A frame is one float32 array ``[C, H, W]`` of planes, whose names and meanings are in `clsim.frames.planes`.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]


@dataclass(slots=True)
class Frame:
    """One rendered frame.

    Attributes:
        planes: float32 ``[C, H, W]``, C-contiguous; row 0 is the top of the image.
        names: the name of each plane, length C.
        time_us: time of the frame [µs].
        index: number of the frame in its sequence; gaps tell of dropped frames.
    """

    planes: FloatArray
    names: tuple[str, ...]
    time_us: int = 0
    index: int = 0

    def __post_init__(self) -> None:
        """Check that the planes and their names agree."""
        if self.planes.ndim != 3 or self.planes.dtype != np.float32 or not self.planes.flags.c_contiguous:
            raise ValueError("planes must be a C-contiguous float32 array [C, H, W]")
        if len(self.names) != self.planes.shape[0]:
            raise ValueError(f"{len(self.names)} plane names for {self.planes.shape[0]} planes")

    @property
    def height(self) -> int:
        """Number of pixel rows."""
        return int(self.planes.shape[1])

    @property
    def width(self) -> int:
        """Number of pixel columns."""
        return int(self.planes.shape[2])

    def plane(self, name: str) -> FloatArray:
        """Return the plane of that name as a view ``[H, W]``; KeyError if the frame lacks it."""
        try:
            view: FloatArray = self.planes[self.names.index(name)]
            return view
        except ValueError:
            raise KeyError(f"the frame has no plane {name!r}; it has {', '.join(self.names)}") from None

    def copy(self) -> Frame:
        """Return a frame with its own memory (a ring's slots are reused; see FrameRing)."""
        planes = page_aligned(self.planes.shape)
        planes[...] = self.planes
        return Frame(planes, self.names, self.time_us, self.index)


def page_aligned(shape: tuple[int, ...]) -> FloatArray:
    """Allocate a zeroed float32 array that starts on a page, as zero-copy OpenCL buffers want it."""
    count = int(np.prod(shape))
    memory = mmap.mmap(-1, max(count, 1) * 4)
    return np.frombuffer(memory, dtype=np.float32, count=count).reshape(shape)


def frame_time_us(index: int, fps: float) -> int:
    """Return the time of frame ``index`` [µs], computed from the index so that no error accumulates."""
    return round(index * 1e6 / fps)
