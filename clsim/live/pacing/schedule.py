"""The schedule of a run: which frames are rendered, and when."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from clsim.errors import InputError
from clsim.frames import frame_time_us

LARGEST_FPS = 1_000_000
LONGEST_S = 1e12
"""At 10⁶ frames a second, their number still has 64 bits."""
_RATE_TOLERANCE = 1e-4
"""Of rates that were rounded by hand: 33.3333 for a third of 100."""


@dataclass(frozen=True)
class Schedule:
    """The frames of a run.

    Attributes:
        fps: frames per simulated second.
        pass_frames: frame intervals in one pass of the motion; frame ``pass_frames`` of a loop is frame 0 again.
        total: number of frames in the run; None never ends.
        loop: whether motion restarts after each pass; otherwise frames beyond the pass continue the motion's end.
        periodic: whether the motion's end meets its start; where it does not, references are reset at the seam.
        recorded_times: whether the source's own times hold, rather than those of ``fps``.
    """

    fps: float
    pass_frames: int
    total: int | None
    loop: bool = False
    periodic: bool = False
    recorded_times: bool = False

    def source_index(self, index: int) -> int:
        """Return the frame of the source that frame ``index`` of the run shows."""
        return index % self.pass_frames if self.loop else index

    def time_us(self, index: int) -> int:
        """Return the time of frame ``index`` of the run [µs]; it runs on over the seams of a loop."""
        return frame_time_us(index, self.fps)

    def crosses_seam(self, previous: int, index: int) -> bool:
        """Tell whether a jump of the motion lies between two frames of the run."""
        return self.loop and not self.periodic and previous // self.pass_frames != index // self.pass_frames


class Continuity:
    """Knows which frames do not continue the one before them, though others may have been dropped between them."""

    def __init__(self, schedule: Schedule) -> None:
        """Prepare for the frames of ``schedule``."""
        self._schedule = schedule
        self._previous = 0
        self._restarts: deque[int] = deque()

    def restart_at(self, index: int) -> None:
        """Take notice that from frame ``index`` on even a still picture is another; for the producer's thread."""
        self._restarts.append(index)

    def breaks(self, index: int) -> bool:
        """Tell whether references must be reset at frame ``index``; for the consumer's thread, once a frame."""
        found = self._schedule.crosses_seam(self._previous, index)
        self._previous = index
        while self._restarts and self._restarts[0] <= index:
            self._restarts.popleft()
            found = True
        return found


def plan(
    scene_duration_s: float,
    fps: float,
    *,
    duration_s: float | None = None,
    frames: int | None = None,
    loop: bool = False,
    periodic: bool = False,
) -> Schedule:
    """Return the schedule of a run: the motion once, or ``duration_s`` or ``frames`` of it, or a loop.

    A run of d seconds has round(d·fps) intervals, hence one frame more: the first one only sets the references.

    Raises:
        InputError: two frames would have the same time, or one a time beyond all that can be told, or the duration is
            less than half a frame.
    """
    if fps < 1 / LONGEST_S:
        raise InputError(f"`fps` must be at least {1 / LONGEST_S:g}, for times end at {LONGEST_S:g} s, got {fps:g}")
    if fps > LARGEST_FPS:
        raise InputError(f"`fps` must be at most {LARGEST_FPS}, for times are whole µs, got {fps:g}")
    pass_frames = max(1, round(scene_duration_s * fps))
    if frames is not None:
        total: int | None = frames
    elif duration_s is not None:
        if duration_s * fps < 0.5:
            raise InputError(
                f"`duration_s` must be at least half a frame, which is {0.5 / fps:.3g} s at {fps:g} frames per second, "
                f"got {duration_s:g}"
            )
        total = round(duration_s * fps) + 1
    else:
        total = None if loop else pass_frames + 1
    return Schedule(fps, pass_frames, total, loop, periodic)


def truth_every(fps: float, frame_rate: float | None) -> int:
    """Return the rendered frames from one frame of truth to the next; raises InputError unless they are whole."""
    if frame_rate is None:
        return 1
    every = max(1, round(fps / frame_rate))
    if abs(fps / every - frame_rate) > _RATE_TOLERANCE * frame_rate:
        slower = max(1, math.ceil(fps / frame_rate))
        near = " and ".join(f"{fps / each:g}" for each in (slower, slower - 1) if each)
        raise InputError(
            f"`fps` ({fps:g}) must be a multiple of `frame_rate`, got {frame_rate:g}; the nearest that work: {near}"
        )
    return every
