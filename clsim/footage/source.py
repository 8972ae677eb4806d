"""What all footage shares: frames of three planes, their times, and how far they move."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from clsim.errors import InputError
from clsim.footage import Transfer
from clsim.footage.displacement import Displacement
from clsim.footage.times import check_rising
from clsim.footage.transfer import quantisation_floor
from clsim.frames import RADIANCE, Frame, SourceEnded, frame_time_us
from clsim.frames.frame import FloatArray

MAX_PIXELS = 1 << 26
"""Largest picture that is decoded."""
_GREEN = 1


@dataclass(frozen=True)
class Reading:
    """What a caller tells of footage, in place of what its files tell.

    Attributes:
        transfer: the transfer function that is undone; None is as the files tell.
        times_us: of the frames [µs]; None are the files' own.
        fps: frames per second; None takes times.
        offset: what is added to the light.
    """

    transfer: Transfer | None = None
    times_us: Sequence[int] | None = None
    fps: float | None = None
    offset: float = 0.0


AS_TOLD = Reading()
"""All as the files tell."""


class Footage(ABC):
    """Frames of linear Rec. 709 light from what a camera recorded; a `FrameSource`.

    Frames are read in order, once.

    Attributes:
        width, height: of the frames [pixels].
        names: R, G and B.
        frame_count: number of frames; None where only the end tells.
        transfer: the transfer function that is undone.
        steps: steps of the stored values from black to white; None for floating point.
        displacement: how far the picture moves from frame to frame, so far.
        warnings: what was assumed because the file does not tell it, one sentence each.
        fps: frames per second, on average, so far as it is known.
    """

    names: tuple[str, ...] = RADIANCE
    frame_count: int | None = None
    fps: float = 30.0

    def __init__(
        self,
        where: str,
        size: tuple[int, int],
        steps: int | None,
        transfer: Transfer,
        reading: Reading,
        warnings: tuple[str, ...] = (),
    ) -> None:
        """Prepare to undo ``transfer``: that of ``reading``, or what was found where it tells none."""
        times_us, fps = reading.times_us, reading.fps
        self.width, self.height = size
        check_size(where, *size)
        self.transfer, self.steps, self.warnings = transfer, steps, warnings
        self.displacement = Displacement(*size)
        self._where, self._times_us, self._offset = where, times_us, reading.offset
        self._given_fps = fps
        if fps is not None:
            self.fps = fps
        self._last_us = -1
        if times_us is not None:
            check_rising(list(times_us), where)
            self.frame_count = len(times_us)

    def floor(self, contrast: float) -> float | None:
        """Return the light below which steps of stored values are coarser than ``contrast``; None for no steps."""
        return None if self.steps is None else quantisation_floor(self.transfer, self.steps, contrast)

    def fill(self, index: int, out: Frame) -> None:
        """Write the next frame, which is number ``index``, into ``out``, whose planes must be R, G, B.

        Raises:
            SourceEnded: there is none.
            InputError: the frame is damaged, has another size, is not later than the one before, or there are times for
                more frames than there are.
        """
        if self._times_us is not None and index >= len(self._times_us):
            raise SourceEnded
        try:
            own_us = self._read(index, out.planes)
        except SourceEnded:
            if self._times_us is None:
                raise
            told = f"ends after {index} frames, but there are {len(self._times_us)} times"
            raise InputError(f"{self._where}: {told}; expected one for each frame") from None
        if self._times_us is not None:
            own_us = self._times_us[index]
        elif self._given_fps is not None:
            own_us = frame_time_us(index, self._given_fps)
        if own_us is None:
            raise InputError(f"{self._where}: frame {index} carries no time; give `fps` or `times`")
        if own_us <= self._last_us:
            raise InputError(
                f"{self._where}: frame {index} is at {own_us} µs, expected later than {self._last_us} µs of the one "
                "before; `fps` or `times` replace the file's times"
            )
        self._last_us = out.time_us = own_us
        out.index = index
        self.displacement.add(out.planes[_GREEN])
        if self._offset:
            out.planes += self._offset

    @abstractmethod
    def _read(self, index: int, out_rgb: FloatArray) -> int | None:
        """Write the next frame's light ``[3, H, W]`` and return its own time [µs]; raises SourceEnded at the end."""

    @abstractmethod
    def close(self) -> None:
        """Release what the source holds; safe to call twice."""


def check_size(where: str, width: int, height: int) -> None:
    """Raise InputError for pictures that are empty or too large."""
    if min(width, height) < 1 or width * height > MAX_PIXELS:
        raise InputError(f"{where}: has {width}×{height} pixels, expected 1 to {MAX_PIXELS} of them")


def whole_us(time_s: Fraction) -> int:
    """Return an exact time in whole µs."""
    return round(time_s * 1_000_000)
