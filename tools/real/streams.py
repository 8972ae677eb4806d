"""Streams of a drifting texture through ideal pixels, a camera and v2e, at the rate of a recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from clsim.events import EventBatch, empty_batch
from clsim.sensor import SensorSettings
from clsim.sensor.lab import Lab
from tools.real.scene import Texture
from tools.real.v2e_model import V2e

LUX = 100.0
"""Where the level is 0."""
STEP_PX, V2E_STEP_PX = 0.5, 1.0
"""Between levels that are told; v2e's own upsampling aims at a pixel a frame."""
LONGEST_STEP_US = 1000
WARM_UP_S = 0.03
"""Before events are taken: filters and references are those of a scene that has been moving."""


@dataclass(frozen=True)
class Taken:
    """A stream: its events, how many its readout had no time for, and the speed of the texture [pixels/s]."""

    events: EventBatch
    lost: int
    speed: float


Run = Callable[[float], Taken]
"""Of a speed [pixels/s]."""


def _times_us(speed: float, seconds: float, step_px: float) -> list[int]:
    step_us = min(max(1.0, 1e6 * step_px / speed), LONGEST_STEP_US)
    count = math.ceil(1e6 * seconds / step_us)
    return [round(1e6 * seconds * k / count) for k in range(count + 1)]


def camera(settings: SensorSettings, texture: Texture, size: tuple[int, int], seconds: float) -> Run:
    """Return what runs clsim's pixels, for so long after a warm-up."""

    def run(speed: float) -> Taken:
        lab = Lab(settings, *size, lux=LUX)
        found, lost, warm_us = [empty_batch(0)], 0, round(1e6 * WARM_UP_S)
        for time_us in _times_us(speed, WARM_UP_S + seconds, STEP_PX):
            fired = lab.to(time_us, texture.at(1e-6 * speed * time_us))
            if time_us > warm_us:
                found.append(fired.events.copy())
                lost += fired.lost
        events = np.concatenate(found)
        return Taken(events[events["t"] >= warm_us], lost, speed)

    return run


def v2e(texture: Texture, size: tuple[int, int], seconds: float) -> Run:
    """Return what runs v2e's."""

    def run(speed: float) -> Taken:
        pixels = V2e(*size)
        found, warm_us = [empty_batch(0)], round(1e6 * WARM_UP_S)
        for time_us in _times_us(speed, WARM_UP_S + seconds, V2E_STEP_PX):
            level = texture.at(1e-6 * speed * time_us)
            found.append(pixels.frame(1e-6 * time_us, 255 * np.exp(level - texture.brightest)))
        events = np.concatenate(found)
        events = events[events["t"] >= warm_us]
        return Taken(events[np.lexsort((events["x"], events["y"], events["t"]))], 0, speed)

    return run


def at_rate(run: Run, count: int, speed: float, tries: int = 7) -> Taken:
    """Return the stream of about so many events: its speed is sought from a first guess [pixels/s]."""
    low, high, best = 0.0, math.inf, None
    for _ in range(tries):
        taken = run(speed)
        if best is None or _off(taken, count) < _off(best, count):
            best = taken
        if _off(taken, count) < math.log(1.03):
            break
        if len(taken.events) < count:
            low = speed
        else:
            high = speed
        wanted = speed * min(max((count / max(len(taken.events), 1)) ** 1.1, 0.2), 5.0)
        speed = wanted if low < wanted < high else math.sqrt(max(low, 1.0) * min(high, 1e6))
    assert best is not None
    return best


def _off(taken: Taken, count: int) -> float:
    return abs(math.log(max(len(taken.events), 1) / count))
