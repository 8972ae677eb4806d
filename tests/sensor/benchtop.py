"""Pixels that are told their levels, without a renderer."""

from dataclasses import replace

import numpy as np

from clsim.opencl.device import choose_device
from clsim.opencl.path import BrightnessPath, Knots
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor import RealPixels, SensorSettings
from clsim.sensor.pixel_stages import Defects, Delay, FrontEnd, Leak, Noise, Refractory, Threshold
from clsim.sensor.stage import Context

NEXT_TO_NOTHING = SensorSettings(
    threshold=Threshold(mismatch=1e-12), noise=Noise(1e-12, 1e-12), defects=Defects(dead_share=1e-12)
)
"""Stages that are on and do nothing: tests that set some of their numbers share kernels. So do those with a leak."""

EVERYTHING = SensorSettings(
    threshold=Threshold(mismatch=0.02),
    front_end=FrontEnd(0.5, 3.0, 300.0),
    noise=Noise((30.0, 20.0), (10.0, 5.0), (10.0, 1000.0), 0.2, shot=0.1),
    leak=Leak(3.0, 0.25, parasitic_hz_per_lux=0.05),
    defects=Defects(hot_share=0.05, dead_share=0.05),
    refractory=Refractory(300.0),
    delay=Delay(30.0, 10.0),
)
"""A sensor all of whose pixels' stages are on."""

SPLITS = {
    "30 fps": [round(k * 1e6 / 30) for k in range(13)],
    "120 fps": [round(k * 1e6 / 120) for k in range(49)],
    "960 fps": [round(k * 1e6 / 960) for k in range(385)],
    "at random": sorted({0, 400_000, *np.random.default_rng(1).integers(1, 400_000, 40).tolist()}),
}
"""Times at which steps end [µs]: one and the same 0.4 s."""


def with_stages(**stages):
    """Return settings in which numbers of some stages are others, such as ``leak={"hz": 1.0}``."""
    base = NEXT_TO_NOTHING
    return replace(base, **{name: replace(getattr(base, name), **numbers) for name, numbers in stages.items()})


class Benchtop:
    """A row or an image of pixels; thresholds are 0.2 and 0.25, and 100 lux are level 0."""

    def __init__(self, settings, width, height=1, *, on=0.2, off=0.25, lux=100.0, seed=1):
        device = choose_device()
        self.grid = Grid(width, height, device.lanes, np.float64)
        self.place = Workplace(device, self.grid, device.queue())
        context = Context(on, off, lux, settings.front_end.follower_s)
        self.pixels = RealPixels(self.place, settings, context, seed)
        self.listed = self.place.allocate((width * height,), np.int32)
        self.place.write(self.listed, np.flatnonzero(np.pad(np.ones((height, width)), self._padding())))
        self.time_us, self.level, self.causes = None, None, []

    def _padding(self):
        return ((0, 0), (0, self.grid.span - self.grid.width))

    def _image(self, level):
        shape = (self.grid.height, self.grid.width)
        return self.place_of(np.pad(np.broadcast_to(level, shape), self._padding()))

    def place_of(self, values, dtype=np.float64):
        values = np.asarray(values, dtype)
        buffer = self.place.allocate(values.shape or (1,), dtype)
        self.place.write(buffer, values)
        return buffer

    def to(self, time_us, level, rows=None):
        """Return the events of the step to ``time_us``, whose level at the end is ``level``: a number or an image.

        ``rows`` are knots of each pixel, (ns from the step's start, level). The first step begins at its end.
        """
        first = self.time_us is None
        start_us = time_us if first else self.time_us
        start = self._image(np.nan if first else self.level)
        knots = None
        if rows is not None:
            knots = Knots(
                self.place_of(np.cumsum([0, *map(len, rows)]), np.int32),
                self.place_of([time for row in rows for time, _ in row] or [0], np.int64),
                self.place_of([level for row in rows for _, level in row] or [0]),
            )
        count = self.grid.width * self.grid.height
        self.fired = self.pixels.step(
            BrightnessPath(start_us, time_us, start, self._image(level), self.listed, count, knots)
        )
        self.time_us, self.level = time_us, level
        self.causes.append(self.fired.causes)
        return self.fired.events

    def along(self, times_us, levels):
        """Return the events over several steps."""
        return np.concatenate([self.to(time, level) for time, level in zip(times_us, levels, strict=True)])


def rates(events, pixels, seconds):
    """Return the mean rates of ON and OFF events [1/s] of a pixel."""
    on = int(events["on"].sum())
    return on / pixels / seconds, (len(events) - on) / pixels / seconds


def intervals_us(events):
    """Return the times between successive events of the same pixel [µs]."""
    order = np.lexsort((events["t"], events["x"], events["y"]))
    sorted_events = events[order]
    same = (np.diff(sorted_events["x"].astype(int)) == 0) & (np.diff(sorted_events["y"].astype(int)) == 0)
    return np.diff(sorted_events["t"])[same]


def planes(bench, kind):
    """Return what pixels keep, by name."""
    memory = {"S": bench.pixels._state, "P": bench.pixels._own}[kind]
    values = bench.place.read(memory).reshape(-1, bench.pixels._pixels)[:, : bench.grid.width]
    found = {name[2:]: values[at].copy() for name, at in bench.pixels._macros.items() if name.startswith(f"{kind}_")}
    if kind == "S":
        for name in found.keys() & {"SINCE", "INPUT_SINCE"}:
            found[name] = found[name].view(np.int64)
    return found
