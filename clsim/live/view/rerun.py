"""Events in rerun's viewer (the [rerun] extra)."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.frames import Frame
from clsim.frames.frame import FloatArray
from clsim.frames.planes import RADIANCE
from clsim.frames.tonemap import ToneMap, brightness_image
from clsim.live.view import FRAME_PERIOD_S
from clsim.live.view.accumulate import EventWindow, colour_indices, signed_image
from clsim.live.view.colormaps import ZERO, lut

PICTURE_US = 33_000
_MOST_POINTS = 50_000


class RerunSink:
    """Logs an event image, the cloud in x, y and t, and the rates of ON and OFF, once in 33 ms of event time."""

    def __init__(self, title: str, width: int, height: int, *, save_to: str | None = None) -> None:
        """Open rerun's viewer, or a file; raises InputError if rerun is missing."""
        rerun = self._rerun = load_rerun()
        self._size = width, height
        self._table = lut()
        self._window = EventWindow()
        self._end_us: int | None = None
        self._tone_maps = {"noisy": ToneMap(), "denoised": ToneMap()}
        self._next_frame_s = 0.0
        self._recording: Any = rerun.RecordingStream("clsim")
        if save_to is not None:
            self._recording.save(save_to)
        else:
            _silence_analytics()
            self._recording.spawn()
        self._recording.log("/", rerun.TextDocument(title), static=True)

    def write(self, events: EventBatch, end_us: int) -> None:
        """Take the events until ``end_us``; see Sink.write."""
        if len(events):
            self._window.push(events.copy())
        if self._end_us is None:
            if not len(events):
                return
            self._end_us = int(events["t"][0]) + PICTURE_US
        while end_us >= self._end_us:
            self._log(self._window.select(self._end_us - PICTURE_US, self._end_us), self._end_us)
            self._end_us += PICTURE_US

    def wants_frame(self) -> bool:
        """Tell whether the last frame is long enough ago."""
        return time.monotonic() >= self._next_frame_s

    def show_frame(self, frame: Frame, level: FloatArray | None) -> None:
        """Log the frame's radiance and the detector's brightness (its logarithm, ``[H, W]``), mapped to 8 bits."""
        self._next_frame_s = time.monotonic() + FRAME_PERIOD_S
        images = {"noisy": np.stack([frame.plane(name) for name in RADIANCE], axis=2)}
        if level is not None:
            images["denoised"] = brightness_image(level)
        self._recording.set_time("event time", duration=frame.time_us * 1e-6)
        for name, linear in images.items():
            self._recording.log(f"frame/{name}", self._rerun.Image(self._tone_maps[name](linear)))

    def close(self) -> None:
        """Hand over what is left."""
        self._recording.flush()

    def _log(self, events: EventBatch, end_us: int) -> None:
        rerun, recording = self._rerun, self._recording
        recording.set_time("event time", duration=end_us * 1e-6)
        image = self._table[colour_indices(signed_image(events, *self._size), 2.0)]
        recording.log("events", rerun.Image(image))
        on = int(events["on"].sum())
        for name, count in (("on", on), ("off", len(events) - on)):
            recording.log(f"rate/{name}", rerun.Scalars(count * 1e6 / PICTURE_US))
        few = events[:: 1 + len(events) // _MOST_POINTS]
        age = (end_us - few["t"]) / PICTURE_US * max(self._size) / 2
        points = np.stack([few["x"], few["y"], age], axis=1, dtype=np.float32)
        colours = self._table[np.where(few["on"], ZERO + 85, ZERO - 85)]
        recording.log("cloud", rerun.Points3D(points, colors=colours, radii=0.4))


def load_rerun() -> Any:
    """Import rerun, or raise InputError."""
    try:
        import rerun
    except ImportError:
        raise InputError("`view` rerun needs rerun: pip install 'clsim[rerun]'") from None
    return rerun


def _silence_analytics() -> None:
    """Switch the viewer's usage statistics off for good: it knows no other way than its own setting."""
    subprocess.run([sys.executable, "-m", "rerun", "analytics", "disable"], capture_output=True, check=False)
