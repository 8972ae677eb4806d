"""What a sensor is, in curves as data sheets have them: measured of its pixels, in a lab of even light.

The readout is measured by itself, and left out of all else: where all pixels fire at once, it alone would show.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.opencl.device import choose_device
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor.lab import Lab, thresholds_of, without
from clsim.sensor.pixel import REQUEST
from clsim.sensor.pixel_stages import FrontEnd
from clsim.sensor.readout import Bus
from clsim.sensor.settings import SensorSettings

FloatArray = npt.NDArray[np.float64]
PIXELS = 400
"""Pixels at each light, and at each contrast."""
BRIGHT_LUX = 1000.0
"""Light under which thresholds are measured: dark current and bandwidth hardly count."""
_LUX = 100.0
_LONGEST_NOISE_S = 100.0
_MOST_NODES = 1e8
"""Draws of shot noise that a measurement may take, over all pixels: some seconds."""
_NOISE_STEPS = 100
"""In so many steps: of what a pixel does in one, there is a limit."""
_STEP_US = 1
_WAIT_US = 10_000
_LONGEST_LATENCY_US = 10_000_000
_RAMP_US = 100_000_000
_REQUESTS, _ASKED_S = 100_000, 2e-3
"""To a readout, at least so many, and for so long."""
_UNNAMED_SIZE = (640, 480)


@dataclass(frozen=True)
class NoiseRates:
    """Mean rates of ON and OFF events [1/s] of a pixel that sees nothing change, for each light [lux]."""

    lux: FloatArray
    on_hz: FloatArray
    off_hz: FloatArray
    seconds: float


@dataclass(frozen=True)
class Latencies:
    """Times [s] from a step of light to the first event of a pixel, for each light before it [lux].

    Rows of ``on_s`` (light is doubled) and ``off_s`` (halved) are the tenth, fiftieth and ninetieth percentile of
    pixels; NaN where fewer pixels fire.
    """

    lux: FloatArray
    on_s: FloatArray
    off_s: FloatArray


@dataclass(frozen=True)
class Responses:
    """Shares of pixels that fire after steps of the level, up and down [natural-log units]."""

    steps: FloatArray
    on: FloatArray
    off: FloatArray


def bandwidth_hz(front: FrontEnd, lux: FloatArray) -> FloatArray:
    """Return where a small sine of light has lost 3 dB [Hz] behind receptor and follower; infinite without either."""
    poles = np.full((2, *lux.shape), math.inf)
    if front.receptor_hz_per_lux is not None:
        poles[0] = front.receptor_hz_per_lux * (lux + front.dark_lux)
    if front.follower_hz is not None:
        poles[1] = front.follower_hz
    low, high = np.sort(poles, axis=0)
    # (1 + f²/low²)(1 + f²/high²) = 2, solved for f²/low².
    ratio = np.where(np.isinf(high), 0.0, low / np.where(np.isinf(high), 1.0, high)) ** 2
    return np.asarray(low * np.sqrt(2 / (1 + ratio + np.sqrt((1 + ratio) ** 2 + 4 * ratio))), np.float64)


def noise_rates(settings: SensorSettings, lux: FloatArray, seed: int = 0) -> NoiseRates:
    """Watch pixels without defects under each of these lights."""
    seconds = _LONGEST_NOISE_S
    if settings.noise.shot > 0:
        node_s = settings.front_end.follower_s / 4
        seconds = min(seconds, _MOST_NODES * node_s / (PIXELS * len(lux)))
    lab = Lab(without(settings, "defects", "readout"), PIXELS, len(lux), seed=seed, lux=_LUX)
    levels = np.log(lux / _LUX)[:, None]
    counts = np.zeros((2, len(lux)))
    # What fires in the first step belongs to the start.
    ends_us = np.linspace(0, 1e6 * seconds * (1 + 1 / _NOISE_STEPS), _NOISE_STEPS + 2).round().astype(int)
    for step, end_us in enumerate(ends_us):
        events = lab.to(int(end_us), levels).events
        if step > 1:
            np.add.at(counts, (events["on"].astype(int), events["y"]), 1)
    off, on = counts / (PIXELS * seconds)
    return NoiseRates(lux, on, off, seconds)


def step_latencies(settings: SensorSettings, lux: FloatArray, seed: int = 0) -> Latencies:
    """Double and halve each of these lights."""
    before = np.log(lux / _LUX)[:, None]
    percentiles = []
    for moved in (math.log(2), -math.log(2)):
        lab = Lab(without(settings, "leak", "noise", "defects", "readout"), PIXELS, len(lux), seed=seed, lux=_LUX)
        lab.to(0, before)
        first = np.full((len(lux), PIXELS), math.inf)
        for end_us in (_STEP_US, _LONGEST_LATENCY_US):
            events = lab.to(end_us, before + moved).events
            np.minimum.at(first, (events["y"], events["x"]), events["t"])
        found = np.quantile(first, (0.1, 0.5, 0.9), axis=1, method="inverted_cdf")
        percentiles.append(np.where(np.isinf(found), math.nan, found * 1e-6))
    return Latencies(lux, *percentiles)


def thresholds(settings: SensorSettings, pixels: int = 4000, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Return the contrast thresholds of ON and of OFF events of pixels [natural-log units], by slow ramps of light."""
    nominal = thresholds_of(settings)
    found = []
    for end in (3 * nominal.on, -3 * nominal.off):
        lab = Lab(without(settings, "leak", "noise", "defects", "delay", "readout"), pixels, seed=seed, lux=BRIGHT_LUX)
        lab.to(0, 0.0)
        events = lab.to(_RAMP_US, end).events
        _, first = np.unique(events["x"], return_index=True)
        found.append(abs(end) * events["t"][first] / _RAMP_US)
    return found[0], found[1]


def step_responses(settings: SensorSettings, seed: int = 0) -> Responses:
    """Let pixels without leak and defects see steps of light of many sizes, noise included, and wait 10 ms."""
    nominal = thresholds_of(settings)
    steps = np.linspace(0, 2 * max(nominal.on, nominal.off), 41)
    shares = []
    for sign in (1, -1):
        lab = Lab(without(settings, "leak", "defects", "readout"), PIXELS, len(steps), seed=seed, lux=BRIGHT_LUX)
        lab.to(0, 0.0)
        fired = np.zeros((len(steps), PIXELS), bool)
        for end_us in (_STEP_US, _WAIT_US):
            events = lab.to(end_us, sign * steps[:, None]).events
            events = events[events["on"] == (sign > 0)]
            fired[events["y"], events["x"]] = True
        shares.append(fired.mean(axis=1))
    return Responses(steps, *shares)


def read_rates(settings: SensorSettings, asked_per_s: FloatArray, seed: int = 0) -> FloatArray:
    """Return how many events leave the chip [1/s] where so many are asked for by pixels all over it, at random times.

    In a scene a chip is asked for less: pixels rest after each event.
    """
    width, height = settings.optics.width or _UNNAMED_SIZE[0], settings.optics.height or _UNNAMED_SIZE[1]
    device = choose_device()
    place = Workplace(device, Grid(width, height, device.lanes, np.float32), device.queue())
    random = np.random.default_rng(seed)
    found = []
    for rate in asked_per_s:
        count = max(_REQUESTS, round(_ASKED_S * rate))
        end_ns = round(1e9 * count / rate)
        asked = np.zeros(count, REQUEST)
        asked["t"] = np.sort(random.integers(1, end_ns, count, endpoint=True))
        asked["x"], asked["y"] = random.integers(0, width, count), random.integers(0, height, count)
        read, _ = Bus(place, settings.readout).run(asked, end_ns)
        # By then queues are as long as they will be, if they come to rest at all.
        late = (read["t"] > end_ns // 2) & (read["t"] <= end_ns)
        found.append(1e9 * np.count_nonzero(late) / (end_ns - end_ns // 2))
    return np.array(found)
