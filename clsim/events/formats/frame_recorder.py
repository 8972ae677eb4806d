"""Frames along with the events of a recording: what ``clsim live --frames`` adds to an AEDAT4 file."""

from __future__ import annotations

import numpy as np

from clsim.events import Causes, EventBatch
from clsim.events.formats.aedat4 import Aedat4Sink
from clsim.frames import Frame
from clsim.frames.planes import RADIANCE
from clsim.frames.tonemap import ToneMap


class FrameRecorder:
    """Writes every frame, as 8-bit sRGB with one exposure for the whole run, behind the events that led to it.

    The exposure is that of the first frame that is not black, so that brightness can be compared between frames.
    """

    planes = RADIANCE

    def __init__(self, sink: Aedat4Sink) -> None:
        """Record to ``sink``, which is closed with the recorder."""
        self.recorded_frames = 0
        self._sink = sink
        self._tone_map = ToneMap(follow=0.0)

    def report(self) -> dict[str, float]:
        """Return the number of frames and, once one was not black, the factor from radiance to what sRGB encodes."""
        exposure = self._tone_map.exposure
        return {"recorded_frames": self.recorded_frames} | ({} if exposure is None else {"exposure": exposure})

    def record(self, frame: Frame, events: EventBatch, causes: Causes | None = None) -> None:
        """Write the events of a step, then the frame that it led to; causes have no place here."""
        self.write(events, frame.time_us)
        first = frame.names.index(RADIANCE[0])
        blue_green_red = np.moveaxis(frame.planes[first : first + 3][::-1], 0, 2)
        self._sink.write_image(frame.time_us, self._tone_map(blue_green_red))
        self.recorded_frames += 1

    def write(self, events: EventBatch, end_us: int) -> None:
        """Write events alone; see Sink.write."""
        self._sink.write(events, end_us)

    def close(self) -> None:
        """Complete the file; see Sink.close."""
        self._sink.close()
